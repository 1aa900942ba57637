import ast
from collections.abc import Sequence
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments.parameters import (
    Parameter,
    parse_values,
    read_parameters,
    split_overrides,
)

SOURCE = '''
def run(track, *, count: int = 3, steps: Sequence[float] = (0.1, 0.2)):
    """Run.

    Args:
        track: Shows progress.
        count: Number of
            trials.
        steps: Of time [s].
    """
'''
PARAMETERS = {
    "count": Parameter(3, "Number of trials."),
    "steps": Parameter((0.1, 0.2), "Of time [s]."),
}


def run(
    track,
    *,
    count: int = 3,
    mass: float = 1.0,
    steps: Sequence[float] = (0.1, 0.2),
    objects: Sequence[str] = (),
    scenario: str = "",
    grip: Literal["wrap", "pinch"] = "wrap",
):
    """Stands in for an experiment."""


def test_parameters_are_the_keyword_arguments_of_run():
    (function,) = ast.parse(SOURCE).body
    assert read_parameters(function) == PARAMETERS


def test_values_may_contain_an_equals_sign():
    assert split_overrides("fake", PARAMETERS, ["count=a=b"]) == {"count": "a=b"}


def test_the_last_of_several_overrides_wins():
    overrides = ["count=1", "steps=[1]", "count=2"]
    split = split_overrides("fake", PARAMETERS, overrides)
    assert split == {"count": "2", "steps": "[1]"}


@pytest.mark.parametrize("override", ["count", "=3", ""])
def test_an_override_needs_key_and_value(override):
    with pytest.raises(ScenarioError, match="must be KEY=VALUE"):
        split_overrides("fake", PARAMETERS, [override])


def test_an_experiment_without_parameters_says_so():
    with pytest.raises(ScenarioError, match="fake: takes no parameters, got 'a'"):
        split_overrides("fake", {}, ["a=1"])


@given(st.integers(1, 10**9), st.floats(1e-9, 1e9))
def test_numbers_keep_their_value_and_type(count, mass):
    values = parse_values("fake", run, {"count": str(count), "mass": repr(mass)})
    assert values == {"count": count, "mass": mass}
    assert isinstance(values["count"], int)


def test_lists_become_tuples():
    texts = {"steps": "[1, 0.5]", "objects": "[mug, bowl]"}
    values = parse_values("fake", run, texts)
    assert values == {"steps": (1.0, 0.5), "objects": ("mug", "bowl")}


def test_text_and_choices_are_taken_as_they_are():
    values = parse_values("fake", run, {"scenario": "kitchen", "grip": "pinch"})
    assert values == {"scenario": "kitchen", "grip": "pinch"}


@pytest.mark.parametrize(
    ("key", "text", "message"),
    [
        ("count", "1.5", "must be a whole number"),
        ("mass", "heavy", "must be a number"),
        ("mass", "0.0", "must be greater than 0"),
        ("mass", ".nan", "must be a number"),
        ("steps", "[0.1, slow]", r"steps\[1\]: must be a number"),
        ("steps", "[]", "needs at least one entry"),
        ("objects", "mug", "must be a list"),
        ("scenario", "3", "must be text"),
        ("grip", "[wrap]", "must be one of wrap, pinch"),
        ("grip", "{", "not valid YAML"),
    ],
)
def test_a_value_that_does_not_fit_is_rejected(key, text, message):
    with pytest.raises(ScenarioError, match=message):
        parse_values("fake", run, {key: text})
