"""The content of a file must have the types of the dataclass that it fills."""

import dataclasses as dc

import pytest

from drake_srg.common.exceptions import (
    ScenarioError,
    checked_types,
    one_line,
    scenario_errors,
    suggest,
)


@pytest.mark.parametrize(
    ("name", "end"),
    [
        ("cuont", "(did you mean 'count'? allowed: count, flag)"),
        ("zzz", "(allowed: count, flag)"),
    ],
)
def test_an_unknown_name_is_answered_with_a_guess_and_the_valid_names(name, end):
    assert suggest(name, ["flag", "count"]) == end
    assert suggest(name, {"flag": 1, "count": 2}) == end


def test_a_message_becomes_one_line():
    assert one_line(ValueError("first\n  second\n")) == "first second"
    assert len(one_line(ValueError("x" * 1000))) == 300


def test_a_failed_assertion_of_drakes_is_a_message():
    assert one_line(SystemExit("abort: Failure:\n dt > 0")) == "abort: Failure: dt > 0"


@pytest.mark.parametrize("code", [None, 0, 2])
def test_an_ordinary_exit_is_no_message(code):
    with pytest.raises(SystemExit):
        one_line(SystemExit(code))


@pytest.mark.parametrize("error", [RuntimeError, ValueError, SystemExit])
def test_exceptions_become_scenario_errors_with_the_name_in_front(error):
    message = r"^kitchen: too heavy$"
    with (
        pytest.raises(ScenarioError, match=message) as caught,
        scenario_errors("kitchen"),
    ):
        raise error("too\nheavy")
    assert isinstance(caught.value.__cause__, error)
    with pytest.raises(ScenarioError, match=r"^too heavy$"), scenario_errors():
        raise error("too heavy")


@pytest.mark.parametrize("error", [KeyboardInterrupt, TypeError, KeyError])
def test_other_exceptions_pass(error):
    with pytest.raises(error), scenario_errors("kitchen"):
        raise error("x")


def test_nested_names_are_put_in_front_one_by_one():
    with (
        pytest.raises(ScenarioError, match=r"^kitchen: directives: no such file$"),
        scenario_errors("kitchen"),
        scenario_errors(),
        scenario_errors("directives"),
    ):
        raise RuntimeError("no such file")


def test_scenario_errors_can_decorate_a_function():
    @scenario_errors("kitchen")
    def build():
        raise RuntimeError("no arm")

    for _ in range(2):
        with pytest.raises(ScenarioError, match=r"^kitchen: no arm$"):
            build()


@dc.dataclass
class Read:
    name: str
    jobs: int | None
    sizes: dict[str, float]


@pytest.mark.parametrize(
    "change", [{"name": 1}, {"jobs": "2"}, {"sizes": [1.0]}, {"sizes": None}]
)
def test_wrong_types_are_named(change):
    (name,) = change
    with pytest.raises(TypeError, match=f"{name}: must be"):
        checked_types(dc.replace(Read("a", 1, {}), **change))
