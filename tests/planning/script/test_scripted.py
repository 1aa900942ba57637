import numpy as np
import pytest
from helpers import port_table, read
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.planning.script.scripted import (
    SCRIPT_MODES,
    ScriptedPlanner,
    ScriptStep,
    minimum_jerk_blend,
)
from drake_srg.types import Mode

HOME = np.array([0.1, -0.2])
SCRIPT = [
    ScriptStep(mode="grasp", duration=1.0, arm=[0.5, 0.0]),
    ScriptStep(mode="close", duration=0.5, closure=0.8, force_limit=0.3),
    ScriptStep(mode="lift", duration=2.0, arm=[0.5, 0.4]),
    ScriptStep(mode="release", duration=0.5, closure=0.0),
]


@pytest.fixture
def at():
    """Return a function that reads an output port at a time."""
    planner = ScriptedPlanner(HOME, SCRIPT)
    context = planner.CreateDefaultContext()

    def read_at(port, time):
        context.SetTime(time)
        return read(planner, context, port)

    return read_at


def test_its_ports_are_those_of_a_planner():
    _, outputs = port_table(ScriptedPlanner(HOME, SCRIPT))
    assert outputs == {
        "position_commanded": 2,
        "closure_commanded": 1,
        "closure_messages": 1,
        "force_limit": 1,
        "mode": None,
        "status": None,
    }


@pytest.mark.parametrize(
    ("time", "mode", "closure", "force_limit"),
    [
        (0.0, Mode.GRASP, 0.0, np.nan),
        (0.999, Mode.GRASP, 0.0, np.nan),
        (1.0, Mode.CLOSE, 0.8, 0.3),
        (1.5, Mode.LIFT, 0.8, 0.3),
        (3.499, Mode.LIFT, 0.8, 0.3),
        (3.5, Mode.RELEASE, 0.0, 0.3),
        (4.0, Mode.DONE, 0.0, 0.3),
        (100.0, Mode.DONE, 0.0, 0.3),
    ],
)
def test_each_step_has_its_time(at, time, mode, closure, force_limit):
    assert at("mode", time) is mode
    assert at("status", time).mode is mode
    assert at("status", time).failure is None
    assert at("closure_commanded", time) == [closure]
    assert at("force_limit", time) == pytest.approx([force_limit], nan_ok=True)


@pytest.mark.parametrize(
    ("time", "messages"), [(0.999, 0), (1.0, 1), (3.4, 1), (3.5, 2), (100.0, 2)]
)
def test_each_closure_is_one_message(at, time, messages):
    assert at("closure_messages", time) == [messages]


def test_a_step_begins_at_a_time_that_is_rounded(at):
    assert at("mode", 500 * 0.002 - 1e-13) is Mode.CLOSE


@pytest.mark.parametrize(
    ("time", "position"),
    [
        (0.0, HOME),
        (0.5, [0.3, -0.1]),  # half way after half of the time
        (1.0, [0.5, 0.0]),
        (1.3, [0.5, 0.0]),  # stays
        (2.5, [0.5, 0.2]),
        (3.5, [0.5, 0.4]),
        (9.0, [0.5, 0.4]),
    ],
)
def test_the_arm_moves_from_step_to_step(at, time, position):
    np.testing.assert_allclose(at("position_commanded", time), position, atol=1e-12)


@given(st.floats(-0.5, 1.5))
def test_the_blend_never_goes_back(s):
    # The minimum-jerk polynomial is 10 s³ - 15 s⁴ + 6 s⁵.
    x = np.clip(s, 0.0, 1.0)
    assert minimum_jerk_blend(s) == pytest.approx(10 * x**3 - 15 * x**4 + 6 * x**5)
    assert 0.0 <= minimum_jerk_blend(s) <= minimum_jerk_blend(s + 0.01) <= 1.0 + 1e-12


def test_the_blend_starts_and_ends_at_rest():
    for end in (0.0, 1.0):
        speed = (minimum_jerk_blend(end + 1e-4) - minimum_jerk_blend(end - 1e-4)) / 2e-4
        assert abs(speed) < 1e-6


def test_a_script_needs_steps_that_fit_the_arm():
    with pytest.raises(ValueError, match=r"planner\.steps: needs at least one step"):
        ScriptedPlanner(HOME, [])
    with pytest.raises(
        ValueError, match=r"planner\.steps\[1\]\.arm: needs .* \(2\), got 1"
    ):
        ScriptedPlanner(HOME, [SCRIPT[0], ScriptStep(arm=[1.0])])


def test_steps_have_modes_of_a_cycle_under_way():
    assert {"grasp", "close", "lift", "transfer", "place", "home"} < set(SCRIPT_MODES)
    assert not {"idle", "done", "failed"} & set(SCRIPT_MODES)
