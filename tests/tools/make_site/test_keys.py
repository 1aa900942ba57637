"""The reference has every scenario key, with type, default, unit and bounds."""

import dataclasses as dc
import typing
from pathlib import Path

import pytest
import yaml

from drake_srg.scenario.schema import Scenario
from make_site.keys import keys_index, keys_pages, scenario_keys

SCENARIOS = Path(__file__).parents[3] / "drake_srg/scenarios"


@pytest.fixture(scope="module")
def keys():
    return scenario_keys()


@pytest.fixture(scope="module")
def by_path(keys):
    return {key.path: key for key in keys}


@pytest.fixture(scope="module")
def pages():
    return keys_pages()


@pytest.fixture(scope="module")
def index():
    return keys_index()


def dataclasses_in(hint):
    """The dataclasses in a type, as one finds them without the tool."""
    if dc.is_dataclass(hint):
        yield hint
    for argument in typing.get_args(hint):
        yield from dataclasses_in(argument)


def reachable(kind, found):
    if kind not in found:
        found.add(kind)
        hints = typing.get_type_hints(kind)
        for field in dc.fields(kind):  # a ClassVar is no key
            for inner in dataclasses_in(hints[field.name]):
                reachable(inner, found)
    return found


def test_every_field_of_every_class_is_a_key(by_path):
    last = {path.rpartition(".")[2] for path in by_path}
    # Tests of one process may have added drivers of their own.
    for kind in reachable(Scenario, set()):
        if not kind.__module__.startswith(("drake_srg.", "pydrake.")):
            continue
        assert {field.name for field in dc.fields(kind)} <= last, kind


def paths(tree, path=""):
    """The keys of a scenario file, as the reference spells them."""
    if isinstance(tree, list):
        for item in tree:
            yield from paths(item, f"{path}[i]")
    elif isinstance(tree, dict):
        for name, value in tree.items():
            yield (inner := f"{path}.{name}" if path else name)
            yield from paths(value, inner)


class Untagged(yaml.SafeLoader):
    """Reads tagged values as if they had no tag."""


Untagged.add_multi_constructor(
    "!",
    lambda loader, suffix, node: (
        loader.construct_mapping(node, deep=True)
        if isinstance(node, yaml.MappingNode)
        else None
    ),
)


def known(path, by_path):
    """Whether the reference has a key: NAME stands for any name."""
    parts = path.replace("[i]", ".[i]").split(".")
    for key in by_path:
        pattern = key.replace("[i]", ".[i]").split(".")
        if len(pattern) == len(parts) and all(
            p in (q, "NAME") for p, q in zip(pattern, parts, strict=True)
        ):
            return True
    return False


@pytest.mark.parametrize("path", sorted(SCENARIOS.glob("*.yaml")), ids=lambda p: p.stem)
def test_keys_of_our_scenarios_are_in_the_reference(path, by_path):
    tree = yaml.load(path.read_text("utf-8"), Untagged)
    for key in ("arm", "objects", "task", "planner", "localizer", "recording"):
        for found in paths(tree.get(key), key):
            # Poses, distributions and the kinds of clutter have sections of their own.
            if not known(found, by_path) and "pose." not in found:
                parent = found.rpartition(".")[0]
                assert by_path.get(parent, "") or found.endswith(("min", "max"))


def test_a_page_shows_every_key(keys, pages, index):
    text = "".join([index, *pages.values()]).replace("<wbr>", "")
    for key in keys:
        assert f">{key.path}</code> |" in text or f"# {key.path}\n" in text


def test_the_index_leads_to_every_page(keys, pages, index):
    first = {key.path.replace("[", ".").split(".")[0] for key in keys}
    for name in first:
        assert (f"[{name}](keys/{name}.md)" in index) == (name in pages)
    assert {"planner", "objects", "gripper", "POSE"} <= set(pages) <= first


@pytest.mark.parametrize(
    ("path", "default", "unit", "bounds"),
    [
        ("sleeping.margin", "`0.005`", "m", "> 0"),
        ("task.place.position", "`[0, 0]`", "m", "2 entries"),
        ("recording.period", "`0.02`", "s", "≥ 0.001, ≤ 0.05"),
        ("plant_config.stiction_tolerance", "`0.0001`", "m/s", ""),
    ],
)
def test_default_unit_and_bounds_are_those_of_the_field(
    path, default, unit, bounds, by_path
):
    key = by_path[path]
    assert (key.default, key.unit, key.bounds) == (default, unit, bounds)


def test_every_key_says_what_it_means(keys):
    assert [key.path for key in keys if not key.comment] == []


def test_the_choices_of_a_tag_are_told_apart(keys):
    tags = {key.tag for key in keys if key.path.startswith("gripper.")}
    assert {"SrgPositionDriver", "SrgTendonDriver", "LinkageDriver"} <= tags


def test_no_default_is_uninitialised_memory(keys):
    # Drake's vector distributions have no default; what they hold is arbitrary.
    assert "e-3" not in "".join(key.default for key in keys).replace("e-3]", "")
