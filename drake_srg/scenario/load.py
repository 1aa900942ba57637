"""The loader of scenario files: bases, overrides, random draws and checks."""

import dataclasses as dc
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common import RandomGenerator
from pydrake.common.schema import UniformVectorX

from drake_srg.arm.driver import ArmPositionDriver
from drake_srg.common.exceptions import ScenarioError, scenario_errors, suggest
from drake_srg.scenario.checks import check_scenario, resolve_pick
from drake_srg.scenario.draws import (
    add_clutter,
    draw_choices,
    draw_distributions,
    key_generator,
)
from drake_srg.scenario.planner import with_planner_tag
from drake_srg.scenario.schema import Scenario
from drake_srg.scenario.typed_yaml import load_typed, merge, parse_yaml, set_key
from drake_srg.theses.script import Script, message_script
from drake_srg.types import Vector

SCENARIOS = Path(__file__).parents[1] / "scenarios"


@dc.dataclass(frozen=True)
class DrawnScenario:
    """A scenario with all its random values drawn, and these values."""

    scenario: Scenario
    # The drawn values, by key as for `--set`: `objects.soup_can.mass`. Each entry of a
    # vector has its own key: `objects.soup_can.position[0]`.
    values: Mapping[str, float | int | str]


def draw_scenario(
    tree: Mapping[str, Any], origin: str, seed: int | None
) -> DrawnScenario:
    """Draw the random values of a scenario's tree, load it and check it.

    Args:
        tree: A tree of `load_tree`; not changed.
        origin: File or name at the start of error messages.
        seed: Replaces `random_seed`, unless None.

    Raises:
        ScenarioError: On the first mistake found: one line that says where it is, what
            is wrong and what is allowed.
    """
    try:
        return _drawn(dict(tree), origin, seed)
    except ScenarioError as error:
        raise ScenarioError(_blamed(str(error), tree, origin)) from None


def _drawn(tree: dict[str, Any], origin: str, seed: int | None) -> DrawnScenario:
    if seed is not None:
        tree["random_seed"] = seed
    # The draws need the seed, so it is checked first.
    seed = load_typed(
        Scenario, {"random_seed": tree.get("random_seed", 0)}, origin
    ).random_seed
    values: dict[str, Any] = {}
    tree = draw_choices(tree, int(seed or 0), origin, values)
    tree = add_clutter(tree, int(seed or 0), origin, values)
    planned = with_planner_tag(_with_arm_driver(resolve_pick(tree, origin)), origin)
    drawn = draw_distributions(planned, int(seed or 0), origin, values)
    scenario: Scenario = load_typed(Scenario, drawn, origin)
    _play_messages(scenario, origin)
    check_scenario(scenario, origin)
    _draw_positions(scenario, origin, values)
    return DrawnScenario(scenario, values)


def _blamed(message: str, tree: Mapping[str, Any], origin: str) -> str:
    """Return a message about a key, which names the base file if that sets the key.

    Args:
        message: The error message, which starts with `origin` and a dotted key.
        tree: The scenario's tree.
        origin: The scenario's file or name.
    """
    _, found, rest = message.partition(f"{origin}: ")
    key, _, problem = rest.partition(": ")
    if not found:
        return message
    path = [] if key == "top level" else key.split(".")
    if unknown := re.match(r"unknown key '([^']*)'", problem):
        path.append(unknown[1])
    try:
        files = _chain(_file(origin))
    except ScenarioError:  # the tree is not from a file
        return message
    for file, own in files:
        if (entry := _entry(path, own)) is not None:
            inherited = file is not files[0][0] and entry == _entry(path, tree)
            return f"{file.name}: {rest}" if inherited else message
    return message


def _entry(path: Sequence[str], tree: Any) -> Any:
    """Return the entry of a tree at a path of keys, or None."""
    for key in path:
        tree = tree.get(key) if isinstance(tree, Mapping) else None
    return tree


def _with_arm_driver(tree: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the tree with position-controlled arms, unless they have tags."""
    arm, arms = tree.get("arm"), tree.get("arms")
    if isinstance(arms, Mapping):
        named = {
            name: _with_arm_driver(each) if isinstance(each, Mapping) else each
            for name, each in arms.items()
        }
        tree = {**tree, "arms": named}
    if not isinstance(arm, Mapping) or "_tag" in arm:
        return tree
    return {**tree, "arm": {**arm, "_tag": f"!{ArmPositionDriver.__name__}"}}


def load_scenario(
    name: str | Path,
    *,
    seed: int | None = None,
    overrides: Iterable[str] = (),
) -> Scenario:
    """Load a scenario, draw its random values and check it.

    Args:
        name: Name of one of the package's scenarios, or path of a YAML file.
        seed: Replaces `random_seed`, unless None.
        overrides: Entries `KEY=VALUE`, with a dotted key and a value in YAML. `object.`
            is short for the picked object's entry.

    Raises:
        ScenarioError: On the first mistake found: one line that says where it is, what
            is wrong and what is allowed.
    """
    return draw_scenario(load_tree(name, overrides), str(name), seed).scenario


def _play_messages(scenario: Scenario, origin: str) -> None:
    """Turn the scenario's messages, if any, into the steps of its script."""
    planner = scenario.planner
    if not isinstance(planner, Script) or planner.messages is None:
        return
    if planner.steps:
        raise ScenarioError(
            f"{origin}: planner.steps: must be empty if there are messages"
        )
    with scenario_errors(origin):
        num_joints = len(scenario.arm.home) if scenario.arm else 0
        planner.steps = message_script(planner.messages, num_joints)


def _draw_positions(scenario: Scenario, origin: str, values: dict[str, Any]) -> None:
    """Draw free places for the objects that have neither position nor pose."""
    objects, pick = scenario.objects, scenario.task.pick
    unplaced = [n for n, o in objects.items() if o.position is None and o.pose is None]
    # The picked object comes first, so that the others do not change its place.
    for names in (
        [n for n in unplaced if n == pick],
        [n for n in unplaced if n != pick],
    ):
        for name, p in _free_places(scenario, origin, names).items():
            objects[name].position = [float(x) for x in p]
            values |= {f"objects.{name}.position[{i}]": float(p[i]) for i in range(2)}


def _free_places(
    scenario: Scenario, origin: str, names: Iterable[str]
) -> dict[str, Vector]:
    """Draw places for the named objects, clear of each other and of placed objects."""
    region, spacing = scenario.task.region, scenario.task.spacing
    uniform = UniformVectorX(np.array(region.min), np.array(region.max))
    generators: dict[str, RandomGenerator] = {
        name: key_generator(scenario.random_seed, f"objects.{name}.position")
        for name in names
    }
    fixed = [np.array(o.position) for o in scenario.objects.values() if o.position]

    def free_place(name: str, taken: list[Vector]) -> Vector | None:
        for _ in range(1000):
            p = np.asarray(uniform.Sample(generators[name]))
            if all(np.linalg.norm(p - other) > spacing for other in taken):
                return p
        return None

    for _ in range(20):  # the first places may leave no room for the last
        places: dict[str, Vector] = {}
        for name in names:
            p = free_place(name, [*fixed, *places.values()])
            if p is None:
                break
            places[name] = p
        else:
            return places
    raise ScenarioError(
        f"{origin}: task.region: must be larger, no free place for {name!r}"
    )


def list_scenarios() -> list[str]:
    """Return the names of the package's scenarios, sorted."""
    return sorted(path.stem for path in SCENARIOS.glob("*.yaml"))


def is_scenario(name: str) -> bool:
    """Return whether `load_tree` accepts a name."""
    return name == "-" or name.endswith(".yaml") or name in list_scenarios()


def load_tree(name: str | Path, overrides: Iterable[str] = ()) -> dict[str, Any]:
    """Read a scenario with its bases and overrides, without drawing or checking.

    Args:
        name: Name of one of the package's scenarios, path of a YAML file, or `-` for
            standard input, whose relative paths start in the working directory.
        overrides: Entries `KEY=VALUE`; see `load_scenario`.

    Returns:
        Plain dicts, lists and values, which can be sent to other processes. A tag is
        the entry `_tag` of its mapping.

    Raises:
        ScenarioError: If a file cannot be read, or an override's key leads nowhere.
    """
    merged: dict[str, Any] = {}
    for file, tree in reversed(_chain(_file(name))):
        merged = merge(merged, tree, file.name)
    override_tree(merged, overrides)
    return merged


def _file(name: str | Path) -> Path:
    is_file = str(name) == "-" or str(name).endswith(".yaml")
    return Path(name) if is_file else _builtin(name)


def override_tree(tree: dict[str, Any], overrides: Iterable[str]) -> None:
    """Change entries of a scenario's tree.

    Args:
        tree: A tree of `load_tree`; changed.
        overrides: Entries `KEY=VALUE`; see `load_scenario`.

    Raises:
        ScenarioError: If an entry is not KEY=VALUE, or its key does not exist.
    """
    for override in overrides:
        key, equals, value = override.partition("=")
        if not (key and equals):
            raise ScenarioError(f"--set {override}: must be KEY=VALUE")
        if key.split(".")[0] == "object":
            task = tree.get("task")
            picked = task.get("pick") if isinstance(task, dict) else None
            if not (picked and isinstance(picked, str)):
                raise ScenarioError(f"--set {key}: the scenario picks no object")
            key = f"objects.{picked}{key.removeprefix('object')}"
        set_key(tree, key, parse_yaml(f"value: {value}", f"--set {key}")["value"])
    _resolve_models(tree, Path.cwd())


def _resolve_models(tree: Mapping[str, Any], folder: Path) -> None:
    """Make relative paths of models in objects and directives absolute.

    Args:
        tree: Tree of a scenario or a part of it; changed.
        folder: The folder to which paths are relative.
    """
    clutter = tree.get("clutter")
    kinds = clutter.get("kinds") if isinstance(clutter, dict) else None
    for group in (tree.get("objects"), kinds):
        for entry in group.values() if isinstance(group, dict) else ():
            model = entry.get("model") if isinstance(entry, dict) else None
            if isinstance(model, str) and "://" not in model:
                entry["model"] = str((folder / Path(model).expanduser()).absolute())
    directives = tree.get("directives")
    if isinstance(directives, dict):  # a variant overrides directives by name
        directives = list(directives.values())
    for entry in directives if isinstance(directives, list) else ():
        added = entry.get("add_model") if isinstance(entry, dict) else None
        file = added.get("file") if isinstance(added, dict) else None
        if isinstance(added, dict) and isinstance(file, str) and "://" not in file:
            path = (folder / Path(file).expanduser()).absolute()
            added["file"] = f"file://{path}"


def _builtin(name: str | Path) -> Path:
    if name not in list_scenarios():
        hint = suggest(str(name), list_scenarios()).removesuffix(")")
        raise ScenarioError(
            f"unknown scenario {str(name)!r} {hint}, or a path that ends in .yaml)"
        )
    return SCENARIOS / f"{name}.yaml"


def _chain(path: Path) -> list[tuple[Path, dict[str, Any]]]:
    """Return the trees of a scenario's file, of its base, and of further bases.

    Raises:
        ScenarioError: If a file cannot be read, or is its own base.
    """
    found: list[tuple[Path, dict[str, Any]]] = []
    while True:
        tree = _read(path)
        base = tree.pop("base", None)
        found.append((path, tree))
        if base is None:
            return found
        if not isinstance(base, str):
            raise ScenarioError(f"{path.name}: base: must be a scenario's name or path")
        following = path.parent / base if base.endswith(".yaml") else _builtin(base)
        if following in [file for file, _ in found]:
            raise ScenarioError(f"{path.name}: base: {base} leads back to itself")
        path = following


def _read(path: Path) -> dict[str, Any]:
    try:
        piped = path == Path("-")
        text = sys.stdin.read() if piped else path.read_text(encoding="utf-8")
    except UnicodeError:
        raise ScenarioError(f"{path}: cannot be read: not text in UTF-8") from None
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        reason = getattr(error, "strerror", None) or str(error)
        raise ScenarioError(f"{path}: cannot be read: {reason}") from None
    tree = parse_yaml(text, path.name)
    if tree is None:
        tree = {}
    if not isinstance(tree, dict):
        raise ScenarioError(f"{path.name}: must be a mapping of keys to values")
    _resolve_models(tree, path.parent)
    return tree
