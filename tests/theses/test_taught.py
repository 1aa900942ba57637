import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeTaughtPlanner
from drake_srg.station.planners import MakeTaughtMotions
from drake_srg.theses.taught import Taught, TaughtPlanner
from drake_srg.types import Blob, Failure, Mode

HOME = np.zeros(2)
MODES = (Mode.PRE_GRASP, Mode.GRASP, Mode.LIFT, Mode.PLACE, Mode.HOME)
WAYPOINTS = {mode: np.array([i + 1.0, 0.0]) for i, mode in enumerate(MODES)}
TIMES = {
    "latency": 0.1,
    "grip_wait": 0.5,
    "release_wait": 0.5,
    "home_wait": 0.5,
    "close_at_home": 1.5,
}
BLOB = Blob("cylinder", "top", (0, 0), RigidTransform([0.3, 0.2, 0.1]), 1.0)


class Motions:
    """Stands in for `TaughtMotions`: every motion takes a second."""

    def __init__(self, failure=None, **config):
        self.q_home = HOME
        poses = {"lift": list(HOME), "place": list(HOME)}
        self.config = Taught(**(poses | TIMES | config))
        self.failure = failure
        self.asked = []

    def plan(self, p_WT):
        self.asked.append(p_WT.tolist())
        if self.failure is not None:
            return PlanningFailure(self.failure, "too far")
        ends = [HOME, *WAYPOINTS.values()]
        return {
            mode: PiecewisePolynomial.FirstOrderHold([0.0, 1.0], np.array([a, b]).T)
            for mode, a, b in zip(MODES, ends[:-1], ends[1:], strict=True)
        }


class Run:
    """Advances a planner whose inputs are fixed values."""

    def __init__(self, motions=None, blobs=(BLOB,)):
        self.motions = motions or Motions()
        self.planner = TaughtPlanner(self.motions, "cylinder")
        self.simulator = Simulator(self.planner)
        self.context = self.simulator.get_mutable_context()
        self.show(*blobs)
        self.grip(False)
        self.follow(0.0)
        self.modes = {}

    def show(self, *blobs):
        self.planner.GetInputPort("blobs").FixValue(self.context, list(blobs))

    def grip(self, gripped):
        port = self.planner.GetInputPort("grasped")
        port.FixValue(self.context, [float(gripped)])

    def follow(self, lag):
        """The arm is where it was sent, or `lag` [rad] off."""
        state = np.append(self.read("position_commanded") + lag, [0.0, 0.0])
        self.planner.GetInputPort("arm_state").FixValue(self.context, state)

    def read(self, port):
        return self.planner.GetOutputPort(port).Eval(self.context)

    def advance(self, end, lag=0.0):
        """Advance, and remember when each mode began."""
        time = self.context.get_time()
        for t in np.arange(time, end, 0.05) + 0.05:
            self.follow(lag)
            self.simulator.AdvanceTo(t)
            self.modes.setdefault(self.read("mode"), round(t, 2))
        return self


def test_it_goes_through_all_waypoints_and_waits_where_the_thesis_waits():
    run = Run().advance(2.5)
    assert run.read("mode") is Mode.CLOSE
    assert run.read("closure_commanded") == 1.0
    run.advance(5.0)
    assert run.read("mode") is Mode.CLOSE, "it waits until the hand has gripped"
    run.grip(True)
    run.advance(12.0)
    begins = np.array([run.modes[mode] for mode in list(Mode) if mode in run.modes])
    #  idle, P1, P2, close, P3, P4, release, home, done; each motion takes a second
    waits = np.diff(begins)[1:]
    assert waits == pytest.approx([1, 1, 3.4, 1, 1, 0.5, 3], abs=0.11)
    status = run.read("status")
    assert (status.mode, status.failure) == (Mode.DONE, None)
    assert (status.attempts, status.cycles, status.looks) == (1, 1, 1)
    assert status.localization.position.tolist() == BLOB.position.tolist()
    assert run.read("position_commanded").tolist() == WAYPOINTS[Mode.HOME].tolist()


def test_the_hand_closes_at_home_at_last():
    run = Run()
    run.grip(True)
    run.advance(6.3)
    assert run.read("mode") is Mode.HOME
    opened = run.read("closure_commanded")[0]
    run.advance(10.0)
    assert (opened, run.read("closure_commanded")[0]) == (0.0, 1.0)


def test_a_grip_that_is_interrupted_does_not_count():
    run = Run().advance(2.5)
    for t in np.arange(2.5, 6.0, 0.4):
        run.grip(round(t / 0.4) % 2)
        run.advance(t + 0.4)
    assert run.read("mode") is Mode.CLOSE


def test_without_a_wait_it_still_waits_for_the_grip():
    no_waits = dict.fromkeys(TIMES, 0.0) | {"latency": 0.1}
    run = Run(Motions(**no_waits)).advance(4.0)
    assert run.read("mode") is Mode.CLOSE
    run.grip(True)
    assert run.advance(4.1).read("mode") is Mode.LIFT


def test_an_arm_that_lags_has_not_arrived():
    run = Run().advance(3.0, lag=0.006)
    assert run.read("mode") is Mode.PRE_GRASP
    assert run.advance(3.1).read("mode") is Mode.GRASP


def test_it_looks_once():
    run = Run().advance(0.5)
    run.show()
    run.advance(1.5)
    assert run.motions.asked == [BLOB.position.tolist()]


def test_other_objects_are_not_taken():
    other = Blob("cup", "top", (0, 0), RigidTransform(), 1.0)
    run = Run(blobs=(other,)).advance(1.0)
    assert run.read("mode") is Mode.FAILED
    assert run.read("status").failure is Failure.NOT_SEEN


def test_a_fixed_pose_needs_no_look():
    run = Run(Motions(grasp=[1.0, 2.0, 3.0]), blobs=()).advance(1.0)
    assert run.motions.asked == [[1.0, 2.0, 3.0]]
    status = run.read("status")
    assert (status.looks, status.localization) == (0, None)
    assert run.read("mode") is Mode.PRE_GRASP


def test_a_pose_out_of_reach_ends_the_task_with_the_reason():
    run = Run(Motions(failure=Failure.OUT_OF_REACH)).advance(0.5)
    status = run.read("status")
    assert (status.mode, status.failure) == (Mode.FAILED, Failure.OUT_OF_REACH)
    assert status.message == "too far"
    assert run.read("position_commanded").tolist() == HOME.tolist()


def test_a_hand_that_never_grips_uses_up_the_time_budget():
    run = Run(Motions(time_budget=4.0)).advance(5.0)
    status = run.read("status")
    assert (status.mode, status.failure) == (Mode.FAILED, Failure.TIME_BUDGET)


def test_two_planners_do_not_share_their_memory():
    first, second = Run(), Run(blobs=())
    first.advance(1.0)
    second.advance(0.2)
    assert (first.read("mode"), second.read("mode")) == (Mode.PRE_GRASP, Mode.IDLE)


ORDER = (Mode.PRE_GRASP, Mode.GRASP, Mode.LIFT, Mode.PLACE, Mode.HOME)
P2 = np.array([-0.325, -0.175, 0.14])


@pytest.fixture(scope="module")
def motions():
    return MakeTaughtMotions(load_scenario("assistive_arm_thesis"))


@pytest.fixture(scope="module")
def planned(motions):
    return motions.plan(P2)


def tip(motions, trajectory, time):
    return motions.moves.tip(trajectory.value(time)[:, 0])


@pytest.mark.slow
def test_every_motion_begins_where_the_last_one_ended(motions, planned):
    assert tuple(planned) == ORDER
    ends = [motions.q_home]
    for trajectory in planned.values():
        np.testing.assert_allclose(trajectory.value(0.0)[:, 0], ends[-1], atol=0.01)
        ends.append(trajectory.value(trajectory.end_time())[:, 0])
    np.testing.assert_allclose(ends[-1], motions.q_home, atol=1e-6)
    np.testing.assert_allclose(ends[3], motions.config.lift, atol=1e-6)
    np.testing.assert_allclose(ends[4], motions.config.place, atol=1e-6)


@pytest.mark.slow
def test_p1_is_beside_the_blob_and_p2_at_it(motions, planned):
    beside, at = (
        tip(motions, planned[mode], planned[mode].end_time()) for mode in ORDER[:2]
    )
    np.testing.assert_allclose(beside, P2 + np.array([0.025, 0.0, 0.0]), atol=3e-4)
    np.testing.assert_allclose(at, P2, atol=3e-4)


@pytest.mark.slow
def test_the_tip_keeps_the_thesis_s_speed(motions, planned):
    for trajectory in planned.values():
        times = np.linspace(0.0, trajectory.end_time(), 400)
        path = np.array([tip(motions, trajectory, t) for t in times])
        speed = np.linalg.norm(np.gradient(path, times, axis=0), axis=1)
        assert np.max(speed) <= 0.1 * 1.01  # the slack of sampling


@pytest.mark.slow
def test_the_tip_moves_on_straight_lines(motions, planned):
    for trajectory in planned.values():
        times = np.linspace(0.0, trajectory.end_time(), 50)
        path = np.array([tip(motions, trajectory, t) for t in times])
        line = (path[-1] - path[0]) / np.linalg.norm(path[-1] - path[0])
        beside = path - path[0] - np.outer((path - path[0]) @ line, line)
        assert np.max(np.linalg.norm(beside, axis=1)) < 2e-3


@pytest.mark.parametrize(
    ("p_WT", "failure"),
    [
        ([-0.9, 0.0, 0.14], Failure.OUT_OF_REACH),
        ([-0.325, -0.175, 0.09], Failure.BLOCKED),
    ],
)
@pytest.mark.slow
def test_what_cannot_be_reached_is_said(motions, p_WT, failure):
    result = motions.plan(np.array(p_WT))
    assert isinstance(result, PlanningFailure)
    assert result.failure is failure


@pytest.mark.slow
def test_either_tip_was_taught_the_same_places(motions):
    before = MakeTaughtMotions(load_scenario("assistive_arm_before"))
    apart = np.linalg.norm(before.moves.p_GT - motions.moves.p_GT)
    assert 1e-3 < apart < 1.5e-3  # a constant offset, beyond the recess's clearance
    for name in ("lift", "place"):
        ours, other = (
            m.moves.tip(np.array(getattr(m.config, name))) for m in (motions, before)
        )
        np.testing.assert_allclose(other, ours, atol=5e-5)


@pytest.mark.slow
def test_a_posture_of_another_arm_is_refused():
    scenario = load_scenario("assistive_arm_thesis")
    scenario.planner.lift = [0.0, 0.0]
    with pytest.raises(
        ValueError, match=r"planner\.lift: needs one entry per joint.*5"
    ):
        MakeTaughtPlanner(scenario)
