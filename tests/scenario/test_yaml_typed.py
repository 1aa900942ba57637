import dataclasses as dc

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pydrake.common.schema import Transform

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario.draws import draw_distributions
from drake_srg.scenario.yaml_tree import parse_yaml
from drake_srg.scenario.yaml_typed import check_tree, load_typed
from drake_srg.types import Box, Cylinder, positive
from scenario.yaml_trees import trees


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
