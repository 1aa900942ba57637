import numpy as np
import pytest

from drake_srg.common.safety_states import SafetyState
from drake_srg.robot.drive.remote_planner import Ended
from drake_srg.simulation.measures import safety_stops
from drake_srg.types import Failure, Mode
from robot.drive.stand import HOME, MOVING, PERIOD, FakeArm, Stand, limits, motion_to

GOAL = HOME + np.array([1.0, 0.2, 0.0, 0.3, 0.0, 0.0, 0.4])


def steps(stand):
    """Speeds of what the arm was sent [rad/s]."""
    return np.abs(np.diff(stand.arm.sent, axis=0)).max(axis=1) / PERIOD


def test_commands_go_on_every_period_while_the_planner_thinks():
    stand = Stand()
    assert stand.run(0.1)
    stand.planner.say(MOVING, motion_to(GOAL, departed=0.1), time=0.1, closure=0.4)
    assert stand.run(2.5)  # no further answer: the planner thinks
    # One command per period, along the whole motion, to its end.
    assert len(stand.arm.sent) == 521  # one at time 0
    np.testing.assert_allclose(stand.arm.sent[-1], GOAL, atol=1e-9)
    assert (np.flatnonzero(steps(stand) > 0.0)[[0, -1]] * PERIOD) == pytest.approx(
        [0.1, 2.1], abs=0.02
    )
    assert stand.gripper.closures[-1] == 0.4


def test_a_pulled_plug_stops_the_arm_within_two_tenths_of_a_second():
    stand = Stand()
    stand.planner.say(MOVING, motion_to(GOAL), time=0.0)
    stand.run(1.0)
    assert steps(stand)[-1] > 0.5
    stand.arm.plugged = False  # while the planner thinks, for 2 s
    assert not stand.run(2.0)
    assert not steps(stand)[round(1.2 / PERIOD) :].any()
    assert stand.loop.safety[0] is SafetyState.PROTECTIVE_STOP
    status = stand.loop.status
    assert status.failure is Failure.STOPPED
    assert "stale" in status.message
    (stop,) = safety_stops(stand.loop.log.arrays())
    assert stop["reason"] == "stale"


def test_the_arm_may_follow_as_late_as_its_link_says():
    class LateArm(FakeArm):
        lag = 0.2

        def take(self):
            q = self.sent[-40] if len(self.sent) >= 40 else HOME  # 0.2 s ago
            return {"arm.state_measured": np.append(q, np.zeros(7))}

    def furthest(arm):
        stand = Stand(arm)
        goal = HOME + np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        stand.planner.say(MOVING, motion_to(goal, duration=2.2))
        stand.run(3.0)
        return stand.arm.sent[-1][0] - HOME[0]

    late = LateArm()
    assert furthest(late) == pytest.approx(2.0)
    unexpected = LateArm()
    unexpected.lag = 0.0
    assert furthest(unexpected) < 1.5


def test_the_emergency_stop_ends_the_run():
    stand = Stand()
    stand.planner.say(MOVING, motion_to(GOAL), time=0.0)
    stand.run(1.0)
    stand.loop.press_estop()
    assert not stand.run(1.0)
    assert not steps(stand)[round(1.2 / PERIOD) :].any()
    assert stand.loop.safety[0] is SafetyState.EMERGENCY_STOP


def test_a_run_ends_some_time_after_its_planner_is_done():
    stand = Stand()
    stand.planner.say(Mode.DONE)
    assert not stand.run(1.0)
    assert stand.loop.time == pytest.approx(0.5, abs=0.02)
    assert stand.loop.status.mode is Mode.DONE


@pytest.mark.parametrize(
    ("messages", "patience"), [([Ended("it broke")], 60.0), ([], 0.3)]
)
def test_without_a_planner_the_arm_comes_to_rest_on_its_path(messages, patience):
    stand = Stand(patience=patience)
    stand.planner.say(MOVING, motion_to(GOAL), time=0.0)
    stand.run(1.0)
    stand.planner.answers += messages
    assert not stand.run(2.0)
    assert steps(stand)[-1] == 0.0
    assert stand.loop.safety[0] is SafetyState.RUNNING
    assert stand.loop.status.failure is Failure.STOPPED
    # Still on the straight line to the goal.
    along = (np.array(stand.arm.sent) - HOME) @ (GOAL - HOME)
    along /= (GOAL - HOME) @ (GOAL - HOME)
    line = HOME + along[:, np.newaxis] * (GOAL - HOME)
    np.testing.assert_allclose(stand.arm.sent, line, atol=1e-9)


def test_the_planner_gets_a_tick_each_of_its_periods():
    stand = Stand()
    stand.run(1.0)
    assert len(stand.planner.ticks) == pytest.approx(100, abs=1)
    values = stand.planner.ticks[-1].values
    np.testing.assert_array_equal(values["arm.state_measured"][:7], HOME)
    assert values["gripper.grasped"] == [0.0]


PRESSED, RELEASED = {"safety.estop": np.ones(1)}, {"safety.estop": np.zeros(1)}
RELEASE = {**RELEASED, "safety.release": np.ones(1)}


def pull_plug(stand):
    stand.arm.plugged = False
    stand.run(0.5)
    stand.arm.plugged = True
    stand.run(0.1)  # until something arrives


def press_button(stand):
    assert stand.loop.advance(PRESSED)
    stand.run(0.5)


STOPS = {"plug": pull_plug, "button": press_button}


@pytest.fixture(params=STOPS)
def stopped(request):
    """A stand whose arm was stopped in the middle of its motion, at 1 s."""
    stand = Stand(release=3.0)
    stand.planner.say(MOVING, motion_to(GOAL), time=0.0, closure=0.7)
    stand.run(1.0)
    STOPS[request.param](stand)
    state, _ = stand.loop.safety
    assert state in (SafetyState.PROTECTIVE_STOP, SafetyState.EMERGENCY_STOP)
    return stand


def assert_within_limits(stand):
    step = np.diff(stand.arm.sent, axis=0)
    assert np.all(np.abs(step) <= limits().step + 1e-9)
    assert np.all(np.abs(np.diff(step, axis=0)) <= limits().brake + 1e-9)


def test_it_goes_on_along_its_path_to_the_goal(stopped):
    assert stopped.run(0.3)  # it waits
    assert stopped.loop.waits
    assert np.max(np.abs(np.subtract(stopped.arm.sent[-1], GOAL))) > 0.2
    assert stopped.loop.advance(RELEASE)
    assert stopped.run(4.0)
    assert stopped.loop.safety[0] is SafetyState.RUNNING
    np.testing.assert_allclose(stopped.arm.sent[-1], GOAL, atol=1e-9)
    assert_within_limits(stopped)
    # Never off the straight line from home to the goal.
    way = GOAL - HOME
    along = (np.array(stopped.arm.sent) - HOME) @ way / (way @ way)
    line = HOME + along[:, np.newaxis] * way
    np.testing.assert_allclose(stopped.arm.sent, line, atol=1e-4)


def test_the_planner_sleeps_meanwhile(stopped):
    ticks = len(stopped.planner.ticks)
    stopped.run(1.0)
    assert len(stopped.planner.ticks) == ticks
    stopped.planner.say(Mode.DONE)  # on its way when the arm was stopped
    stopped.run(0.1)
    assert stopped.loop.status.mode is MOVING
    stopped.loop.advance(RELEASE)
    stopped.run(3.0)
    assert stopped.loop.status.mode is Mode.DONE


def test_the_gripper_holds_meanwhile(stopped):
    assert stopped.gripper.holds[-1] == 1.0
    assert stopped.gripper.closures[-1] == 0.7
    stopped.loop.advance(RELEASE)
    stopped.run(0.1)
    assert stopped.gripper.holds[-1] == 0.0
    assert stopped.gripper.closures[-1] == 0.7
    before = stopped.gripper.holds[: round(0.9 / PERIOD)]
    assert not any(before)


def test_it_may_be_stopped_and_released_again(stopped):
    for _ in range(2):
        stopped.loop.advance(RELEASE)
        stopped.run(0.6)  # on its way back, or just gathering speed
        press_button(stopped)
        assert stopped.loop.safety[0] is SafetyState.EMERGENCY_STOP
    stopped.loop.advance(RELEASE)
    stopped.run(4.0)
    np.testing.assert_allclose(stopped.arm.sent[-1], GOAL, atol=1e-9)
    assert_within_limits(stopped)


def test_without_a_release_the_run_ends(stopped):
    assert not stopped.run(5.0)
    assert stopped.loop.status.failure is Failure.STOPPED
    assert stopped.loop.time < 5.2


def test_the_user_may_end_it(stopped):
    stopped.loop.press_estop()
    assert not stopped.run(2.0)
    assert stopped.loop.status.failure is Failure.STOPPED


def test_a_release_before_the_cause_is_over_does_nothing():
    stand = Stand(release=10.0)
    stand.planner.say(MOVING, motion_to(GOAL), time=0.0)
    stand.run(1.0)
    stand.arm.plugged = False
    stand.run(0.5)
    stand.loop.advance(RELEASE)
    stand.run(0.5)
    assert stand.loop.safety[0] is SafetyState.PROTECTIVE_STOP
