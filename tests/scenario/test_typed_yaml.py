import dataclasses as dc
import types
import typing

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pydrake.common.schema import Transform

from drake_srg.common.exceptions import ScenarioError
from drake_srg.config import positive
from drake_srg.robot.drive.config import HardwareConfig
from drake_srg.scenario import typed_yaml
from drake_srg.scenario.draws import draw_distributions
from drake_srg.scenario.schema import Scenario
from drake_srg.scenario.typed_yaml import (
    check_tree,
    entry_names,
    load_typed,
    merge,
    parse_yaml,
    set_key,
)
from drake_srg.types import Box, Cylinder
from scenario.yaml_trees import trees

# Parsing.


@pytest.mark.parametrize("text", ["", "# a comment\n", "---\n"])
def test_a_file_without_content_is_none(text):
    assert parse_yaml(text, "f") is None


def test_a_tag_becomes_an_entry_of_its_mapping():
    assert parse_yaml("a: !Foo {b: 1}", "f") == {"a": {"_tag": "!Foo", "b": 1}}


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        "a: [1",
        "a:\t1\n\tb: 2",
        "a: 1\n---\nb: 2",
        "a: \x00",
        "a: !Foo 3",
        "a: *nothing",
        "a: " + "[" * 2000,
        pytest.param("a: " + "[" * 200_000 + "]" * 200_000, id="deep"),
    ],
)
def test_invalid_yaml_is_reported_in_one_line(text):
    with pytest.raises(ScenarioError, match=r"^f: not valid YAML: ") as error:
        parse_yaml(text, "f")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("key", ["1", "yes", "~", "2.5", "[1, 2]"])
@pytest.mark.parametrize("text", ["{}: 1", "a: {{{}: 1}}", "a: [{{{}: 1}}]"])
def test_keys_must_be_text(key, text):
    with pytest.raises(ScenarioError, match=r"^f: keys must be text"):
        parse_yaml(text.format(key), "f")


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("a: 1\nb: 2\na: 3", 3),
        ("c: {a: 1, 'a': 2}", 1),
        ("c:\n- {b: 1}\n- a: 1\n  a: 1", 4),
        ("c: !Tag\n  a: 1\n  a: 2", 3),
        ("_c: &x {b: 1}\nd:\n  <<: *x\n  a: 2\n  a: 2", 5),
    ],
)
def test_a_key_twice_is_refused_by_line(text, line):
    with pytest.raises(ScenarioError, match=rf"^f: line {line}: key 'a' is in line \d"):
        parse_yaml(text, "f")


def test_a_key_may_be_merged_and_set():
    tree = parse_yaml("_c: &x {b: 1}\nd: {<<: *x, b: 2}\ne: *x", "f")
    assert tree == {"d": {"b": 2}, "e": {"b": 1}}


def test_a_part_that_contains_itself_is_refused():
    with pytest.raises(ScenarioError, match=r"^f: .*contains itself"):
        parse_yaml("a: &x [1, [*x]]", "f")
    shared = parse_yaml("a: &x [1]\nb: [*x, *x]", "f")
    assert shared == {"a": [1], "b": [[1], [1]]}


# Bases and overrides.


def test_merge_lays_mappings_over_mappings():
    base = {"a": {"b": 1, "c": 2}, "d": [1, 2]}
    assert merge(base, {"a": {"c": 3}, "d": [4]}) == {"a": {"b": 1, "c": 3}, "d": [4]}


def test_merge_replaces_a_mapping_with_another_tag():
    base = {"_tag": "!A", "b": 1}
    assert merge(base, {"_tag": "!C", "d": 2}) == {"_tag": "!C", "d": 2}
    assert merge(base, {"_tag": "!A", "d": 2}) == {"_tag": "!A", "b": 1, "d": 2}
    assert merge(base, {"d": 2}) == {"_tag": "!A", "b": 1, "d": 2}


@pytest.mark.slow
@given(trees, trees)
def test_merge_is_idempotent_and_changes_neither_argument(base, override):
    before = repr((base, override))
    try:
        merged = merge(base, override)
    except ScenarioError:  # the override names an entry that a list does not have
        merged = None
    assert repr((base, override)) == before
    if merged is not None:
        assert repr(merge(merged, override)) == repr(merged)


DIRECTIVES = """
- add_model: {name: table, file: "package://p/table.sdf"}
- add_weld: {parent: world, child: "table::top"}
- add_directives: {file: "package://p/arm_tip.dmd.yaml"}
- {name: lamp, power: 3}
"""


def test_entries_are_named_after_what_they_add():
    names = entry_names(parse_yaml(DIRECTIVES, "f"))
    assert names == ["table", "table::top", "arm_tip", "lamp"]


@pytest.mark.parametrize("text", ["[]", "[1, 2]", "[{name: a}, {power: 2}]", "[[1]]"])
def test_a_list_has_names_only_if_all_its_entries_do(text):
    assert entry_names(parse_yaml(text, "f")) == []


def test_entries_of_a_list_are_overridden_by_name():
    base = {"directives": parse_yaml(DIRECTIVES, "f")}
    merged = merge(base, {"directives": {"table": {"add_model": {"file": "x.sdf"}}}})
    assert merged["directives"][0] == {"add_model": {"name": "table", "file": "x.sdf"}}
    assert merged["directives"][1:] == base["directives"][1:]


def test_an_index_is_refused_and_the_name_is_suggested():
    base = {"directives": parse_yaml(DIRECTIVES, "f")}
    message = (
        r"^f: directives: entries are overridden by name, got '1' \(write "
        r"'table::top' instead of '1'; allowed: table, table::top, arm_tip, lamp\)$"
    )
    with pytest.raises(ScenarioError, match=message):
        merge(base, {"directives": {"1": {}}}, "f")


def test_an_unknown_name_is_refused_and_the_names_are_listed():
    base = {"directives": parse_yaml(DIRECTIVES, "f")}
    message = r"f: directives: .* got 'chair' \(allowed: table, table::top, arm_tip"
    with pytest.raises(ScenarioError, match=message):
        merge(base, {"directives": {"chair": {}}}, "f")


def test_a_list_without_names_is_overridden_as_a_whole():
    assert merge({"a": [1, 2]}, {"a": [3]}) == {"a": [3]}
    with pytest.raises(ScenarioError, match=r"^f: a: entries have no names: override"):
        merge({"a": [1, 2]}, {"a": {"0": 3}}, "f")


def test_a_distribution_replaces_a_list():
    vector = {"_tag": "!UniformVector", "min": [0], "max": [1]}
    assert merge({"a": [1]}, {"a": vector}) == {"a": vector}


def test_set_key_adds_mappings_on_the_way():
    tree = {"a": {"b": 1}, "n": None}
    set_key(tree, "a.c.d", 2)
    set_key(tree, "n.m", 3)
    assert tree == {"a": {"b": 1, "c": {"d": 2}}, "n": {"m": 3}}


def test_set_key_to_an_empty_mapping_replaces_the_old_value():
    tree = {"a": {"b": 1}, "c": {"_tag": "!C", "d": 1}}
    set_key(tree, "a", {})
    set_key(tree, "c", {"_tag": "!C"})
    assert tree == {"a": {}, "c": {"_tag": "!C", "d": 1}}


def test_set_key_cannot_lead_through_a_scalar():
    with pytest.raises(ScenarioError, match=r"--set a\.b\.c: a\.b is a value"):
        set_key({"a": {"b": 1}}, "a.b.c", 2)


def test_set_key_finds_list_entries_by_name():
    tree = {"directives": parse_yaml(DIRECTIVES, "f")}
    set_key(tree, "directives.table::top.add_weld.parent", "floor::top")
    set_key(tree, "directives.lamp.power", 4)
    assert tree["directives"][1]["add_weld"]["parent"] == "floor::top"
    assert tree["directives"][3]["power"] == 4
    message = r"^--set directives\.3\.power: directives: .*write 'lamp' instead of '3'"
    with pytest.raises(ScenarioError, match=message):
        set_key(tree, "directives.3.power", 5)


def test_set_key_finds_entries_of_lists_without_names_by_index():
    tree = {"a": [{"b": 1}, {"c": [3, 4]}]}
    set_key(tree, "a.0.b", 2)
    set_key(tree, "a.0.d.e", 5)
    set_key(tree, "a.1.c.1", 6)
    assert tree == {"a": [{"b": 2, "d": {"e": 5}}, {"c": [3, 6]}]}


@pytest.mark.parametrize("index", ["2", "-1", "x", "1.5", "", "²"])
@pytest.mark.parametrize("rest", ["", ".b"])
def test_set_key_needs_an_existing_index(index, rest):
    with pytest.raises(ScenarioError) as error:
        set_key({"a": [{"b": 1}, 2]}, f"a.{index}{rest}", 3)
    if index != "1.5":  # its 1 is an index, but of a scalar
        assert "unknown index" in str(error.value)


def test_set_key_finds_no_entry_in_an_empty_list():
    with pytest.raises(
        ScenarioError, match=r"unknown index '0' \(allowed: none, the list is empty\)"
    ):
        set_key({"a": []}, "a.0", 1)


@given(st.lists(st.integers(), min_size=1, max_size=4), st.data())
def test_set_key_changes_one_entry_of_a_list(values, data):
    i = data.draw(st.integers(0, len(values) - 1))
    tree = {"a": list(values)}
    set_key(tree, f"a.{i}", "new")
    assert tree == {"a": [*values[:i], "new", *values[i + 1 :]]}


@dc.dataclass
class Inner:
    number: float = 1.0
    count: int = dc.field(default=2, metadata={"ge": 0})
    text: str = "a"
    flag: bool = False


@dc.dataclass
class Outer:
    inner: Inner = dc.field(default_factory=Inner)
    maybe: float | None = None
    numbers: list[float] = dc.field(
        default_factory=lambda: [1.0, 2.0], metadata=positive(length=2, le=9.0)
    )
    shape: Cylinder | Box | None = None
    table: dict[str, Inner] = dc.field(default_factory=dict)
    pose: Transform = dc.field(default_factory=Transform)
    law: str = dc.field(default="pid", metadata={"among": ("pid", "printed")})
    stages: list[float] = dc.field(
        default_factory=lambda: [1.0], metadata={"nonempty": True}
    )


def load(text):
    return load_typed(Outer, draw_distributions(parse_yaml(text, "f"), 0, "f"), "f")


def test_valid_values_are_converted():
    outer = load(
        "inner: {number: 1e-3, count: 3.0, text: b, flag: true}\n"
        "numbers: [3, 4.5]\nshape: !Box {size: [1, 2, 3]}\ntable: {x: {count: 0}}\n"
        "maybe: !Uniform {min: 2, max: 2}\npose: {translation: [1, 2, 3]}\n"
        "law: printed"
    )
    assert outer.inner == Inner(1e-3, 3, "b", True)
    assert isinstance(outer.inner.count, int)
    assert outer.numbers == [3.0, 4.5]
    assert outer.shape == Box([1.0, 2.0, 3.0])
    assert outer.table == {"x": Inner(count=0)}
    assert outer.maybe == 2.0
    np.testing.assert_array_equal(outer.pose.translation, [1, 2, 3])
    assert outer.law == "printed"


def test_a_missing_value_keeps_its_default():
    assert load("inner:").inner == Inner()
    assert load("maybe: null").maybe is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("iner: {}", "top level: unknown key 'iner' (did you mean 'inner'? allowed: "),
        (
            "inner: {cout: 1}",
            "inner: unknown key 'cout' (did you mean 'count'? allowed",
        ),
        ("inner: {zzz: 1}", "inner: unknown key 'zzz' (allowed: count, flag, number"),
        ("inner: 3", "inner: must be a mapping, got 3"),
        ("inner: [1]", "inner: must be a mapping, got a list"),
        ("inner: !Iner {}", "inner: must have the tag !Inner or none, got !Iner"),
        ("inner: {number: x}", "inner.number: must be a number, got 'x'"),
        ("inner: {number: true}", "inner.number: must be a number, got true"),
        ("inner: {number: null}", "inner.number: must be a number, got null"),
        ("inner: {number: {}}", "inner.number: must be a number, got a mapping"),
        ("inner: {number: .nan}", "inner.number: must be a number, got NaN"),
        ("inner: {number: .inf}", "inner.number: must be finite, got inf"),
        (
            "inner: {number: !Unifrom {min: 1, max: 2}}",
            "inner.number: unknown tag !Unifrom (did you mean '!Uniform'? allowed: ",
        ),
        ("inner: {count: 1.5}", "inner.count: must be a whole number, got 1.5"),
        ("inner: {count: .inf}", "inner.count: must be finite, got inf"),
        ("inner: {count: 1.0e+400}", "inner.count: must be finite, got inf"),
        ("inner: {count: -1}", "inner.count: must be at least 0, got -1"),
        ("inner: {text: 3}", "inner.text: must be text, got 3"),
        ("inner: {flag: 1}", "inner.flag: must be true or false, got 1"),
        ("numbers: 3", "numbers: must be a list, got 3"),
        ("numbers: [1]", "numbers: needs 2 numbers, got 1"),
        ("stages: []", "stages: must not be empty"),
        ("numbers: [1, 0]", "numbers: must be greater than 0.0, got 0.0"),
        ("numbers: [1, 10]", "numbers: must be at most 9.0, got 10.0"),
        ("numbers: [1, -.inf]", "numbers: must be finite, got -inf"),
        ("numbers: [1, x]", "numbers[1]: must be a number, got 'x'"),
        ("shape: !Ball {}", "shape: unknown tag !Ball (allowed: !Box, !Cylinder"),
        ("shape: !Boxx {}", "shape: unknown tag !Boxx (did you mean '!Box'? allowed"),
        ("shape: {size: [1, 1, 1]}", "shape: needs a tag (allowed: !Box, !Cylinder)"),
        ("shape: !Box {radius: 1}", "shape: unknown key 'radius' (allowed: size"),
        ("table: [1]", "table: must be a mapping, got a list"),
        ("table: {x: {y: 1}}", "table.x: unknown key 'y' (allowed: "),
        ("pose: {rotaton: 1}", "pose: unknown key 'rotaton' (did you mean 'rotation'?"),
        ("pose: 3", "pose: must be a mapping, got 3"),
        ("pose: {rotation: !Rpx {}}", "pose.rotation: unknown tag !Rpx (did you mean"),
        ("pose: {translation: [1, 2]}", "pose: cannot be read: "),
        ("law: pdi", "law: must be one of pid, printed; got 'pdi'"),
    ],
)
def test_a_mistake_is_reported_with_file_key_and_what_is_allowed(text, message):
    with pytest.raises(ScenarioError) as error:
        load(text)
    assert str(error.value).startswith(f"f: {message}")
    assert "\n" not in str(error.value)


@given(trees)
def test_bad_trees_only_raise_scenario_errors(tree):
    try:
        load_typed(Outer, tree, "f")
    except ScenarioError as error:
        assert "\n" not in str(error)


@pytest.mark.slow
@given(st.dictionaries(st.sampled_from([f.name for f in dc.fields(Outer)]), trees))
def test_bad_trees_under_valid_keys_only_raise_scenario_errors(tree):
    test_bad_trees_only_raise_scenario_errors.hypothesis.inner_test(tree)


@pytest.mark.slow
@example(
    {
        "inner": {"number": "1e-3", "count": 3.0},
        "shape": {"_tag": "!Box", "size": [1, 2, 3]},
        "table": {"x": None},
        "pose": {"rotation": {"_tag": "!Rpy", "deg": [0, 0, 90]}},
    }
)
@given(trees)
def test_checking_is_idempotent(tree):
    try:
        checked = check_tree(tree, Outer, "f")
    except ScenarioError:
        return
    assert check_tree(checked, Outer, "f") == checked


def test_a_loaded_value_is_the_callers_own():
    text = "numbers: [3, 4]\ntable: {x: {count: 0}}\npose: {translation: [1, 2, 3]}"
    first = load(text)
    first.numbers[0], first.table["x"].count, first.pose.translation = 5.0, 7, [0, 0, 0]
    again = load(text)
    assert (again.numbers, again.table) == ([3.0, 4.0], {"x": Inner(count=0)})
    np.testing.assert_array_equal(again.pose.translation, [1, 2, 3])


# Entries that a variant removes.


def mappings(schema, path=()):
    """Yield the paths of all mappings of a schema whose keys are free."""
    generic, kinds = typing.get_origin(schema), typing.get_args(schema)
    if generic is dict:
        yield path
        yield from mappings(kinds[1], (*path, "a"))
    elif generic is list:
        yield from mappings(kinds[0], (*path, 0))
    elif generic in (typing.Union, types.UnionType):
        tagged = [k for k in kinds if typed_yaml._fields(k)]
        for kind in tagged:
            tag = [f"!{typed_yaml._base_name(kind)}"] if len(tagged) > 1 else []
            yield from mappings(kind, (*path, *tag))
    else:
        for name, (kind, _) in (typed_yaml._fields(schema) or {}).items():
            yield from mappings(kind, (*path, name))


def tree_at(path, value):
    """Return a tree with a value at a path, and the value's reader."""
    for key in reversed(path):
        if isinstance(key, int):
            value = [value]
        elif key.startswith("!"):
            value = {**value, "_tag": key}
        else:
            value = {key: value}
    return value


def value_at(path, tree):
    for key in path:
        if isinstance(key, int) or not key.startswith("!"):
            tree = tree[key]
    return tree


@pytest.mark.parametrize("schema", [Scenario, HardwareConfig])
def test_null_removes_an_entry_of_any_mapping(schema):
    paths = list(mappings(schema))
    expected = ["objects"] if schema is Scenario else ["cameras"]
    assert [path for path in paths if list(path) == expected]
    for path in paths:
        tree = tree_at(path, {"gone": None})
        assert value_at(path, check_tree(tree, schema, "f")) == {}, path


def test_null_removes_an_entry_of_a_list_with_names():
    base = {"list": [{"name": "a"}, {"name": "b"}]}
    assert merge(base, {"list": {"a": None}}) == {"list": [{"name": "b"}]}
    set_key(base, "list.b", None)
    assert base == {"list": [{"name": "a"}]}
