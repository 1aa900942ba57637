"""Tasks that fail, each for its reason, and objects that slip out of the hand."""

import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.planning.pick_and_place.task_motions import TaskMotions
from drake_srg.types import Failure, Mode
from planning.planning_world import CAN, CYCLE, GOAL, START, World, blob

ESCAPE = [Mode.RELEASE, Mode.RETREAT, Mode.HOME]
CARRYING = [Mode.LIFT, Mode.TRANSFER, Mode.PLACE]
_STOP = 0.4  # duration of a stop in the middle of a motion [s]


def test_an_object_that_is_nowhere_is_given_up_after_the_search_time():
    world = World(search_time=0.5)
    world.where = lambda mode: []
    status = world.fail(Failure.NOT_SEEN, "can")
    assert world.camera.evaluations == status.looks == 3  # at 0, 0.25 and 0.5 s
    assert world.time == pytest.approx(0.5, abs=2 * world.period)
    assert status.attempts == 0


@pytest.mark.parametrize("failure", [Failure.BLOCKED, Failure.OUT_OF_REACH])
def test_a_task_without_a_plan_fails_for_the_planner_s_reason(failure):
    world = World()
    world.task_planner.result = PlanningFailure(failure, "there is a wall")
    assert world.fail(failure, "there is a wall").attempts == 0
    assert np.ptp(world.commands, axis=0).max() == 0.0


@pytest.mark.parametrize("attempts", [1, 2])
def test_the_task_fails_after_all_attempts_to_grasp(attempts):
    world = World(max_attempts=attempts)
    world.holding = lambda mode: False
    status = world.fail(Failure.NO_GRASP, "nothing of the right size")
    assert status.attempts == attempts
    assert Mode.LIFT not in world.trace


@pytest.mark.parametrize("lost_in", [Mode.LIFT, Mode.TRANSFER])
def test_an_object_lost_on_the_way_is_dropped(lost_in):
    world = World(max_attempts=1)
    on_the_way = CYCLE[CYCLE.index(Mode.CLOSE) : CYCLE.index(lost_in)]
    world.holding = lambda mode: mode in on_the_way
    world.where = lambda mode: [blob(START)]
    world.fail(Failure.DROPPED, "got lost")
    assert world.trace[-5:] == [lost_in, *ESCAPE, Mode.FAILED]


def test_a_dropped_object_that_is_not_seen_again_is_reported_as_dropped():
    world = World(max_attempts=2)
    world.holding = lambda mode: mode in (Mode.CLOSE, Mode.VERIFY)
    there = world.where
    world.where = lambda mode: there(mode) if world.status.attempts == 0 else []
    assert world.fail(Failure.DROPPED).attempts == 1


@pytest.mark.parametrize(("off", "failure"), [(4e-3, None), (6e-3, Failure.MISPLACED)])
def test_the_object_must_be_within_the_tolerance_of_its_goal(off, failure):
    world = World(max_attempts=2)
    seen = blob(GOAL + off * np.array([0.6, 0.0, 0.8]))
    world.show(lambda: [seen], modes=[Mode.HOME])
    status = world.run()
    assert status.failure is failure
    assert status.attempts == (1 if failure is None else 2)


def test_an_object_that_lies_on_its_goal_is_misplaced():
    world = World(max_attempts=1)
    lying = blob(GOAL, axis=[1.0, 0.0, 0.0])
    world.show(lambda: [lying], modes=[Mode.HOME])
    world.fail(Failure.MISPLACED)


def test_an_arm_that_does_not_arrive_fails_as_stopped():
    world = World(arrival_timeout=0.5)
    world.arm_follows = False
    world.fail(Failure.STOPPED, "blocks it")
    assert world.trace == [Mode.IDLE, Mode.PRE_GRASP, Mode.FAILED]


def test_a_spent_time_budget_ends_the_task():
    world = World(time_budget=0.3, latency=0.1)
    world.fail(Failure.TIME_BUDGET, "time budget")
    assert world.time == pytest.approx(0.3, abs=2 * world.period)


def test_a_stop_in_the_middle_of_a_motion_brakes_gently():
    # In PRE_GRASP the first joint moves at 10 rad/s, for 0.1 s.
    world = World(time_budget=0.15, latency=0.1)
    world.run()
    stopped, times = world.time, np.linspace(0.0, 0.04, 5)
    positions = []
    for t in times:
        world.root.SetTime(stopped + t)
        positions.append(world.read("position_commanded")[0])
    speeds = np.diff(positions) / np.diff(times)
    assert positions[0] == pytest.approx(world.commands[-1][0])  # no jump
    # An even stop from 10 rad/s in 0.4 s takes off 0.25 rad/s every 0.01 s.
    np.testing.assert_allclose(speeds, 9.875 - 0.25 * np.arange(4))


def test_an_arm_without_an_escape_ends_the_task():
    world = World()
    world.holding = lambda mode: False
    world.task_planner.escape = PlanningFailure(Failure.BLOCKED, "stuck")
    world.fail(Failure.NO_GRASP, "stuck")


# Objects that slip out of the hand on the way.


def losing_in(mode, world, attempts=1):
    """Let the first attempts lose the object in a mode; it is back at its start."""
    before = CYCLE[: CYCLE.index(mode)]
    world.holding = lambda now: now in before or world.status.attempts > attempts
    world.where = lambda now: [
        blob(GOAL if now is Mode.HOME and world.status.attempts > attempts else START)
    ]


def placed_in(world):
    """Let the cameras see the object on its goal once it has been placed."""
    world.where = lambda mode: [blob(GOAL if Mode.PLACE in world.trace else START)]


@pytest.mark.parametrize("mode", CARRYING)
def test_the_arm_stops_and_takes_the_lost_object_again(mode):
    world = World(slip_time=0.03)
    losing_in(mode, world)
    status = world.run()
    assert world.trace == [*CYCLE[: CYCLE.index(mode) + 1], *ESCAPE, *CYCLE]
    assert (status.mode, status.failure, status.attempts) == (Mode.DONE, None, 2)
    # It takes two updates to notice the loss, and one to notice the end of the stop.
    stopped = world.began[Mode.RELEASE] - world.began[mode]
    assert stopped == pytest.approx(0.03 + _STOP, abs=3 * world.period)


def test_an_arm_that_loses_the_object_brakes_along_its_path():
    world = World(slip_time=0.03, max_attempts=1)
    losing_in(Mode.TRANSFER, world)
    world.fail(Failure.DROPPED, "got lost")
    # The fake motions move 1 rad in 0.1 s; steps are no larger anywhere.
    until = round(world.began[Mode.RELEASE] / world.period)
    steps = np.abs(np.diff(world.commands[:until], axis=0))
    assert np.max(steps) <= 0.1 + 1e-9


@pytest.mark.parametrize(("closed", "lost"), [(0.02, False), (0.1, True)])
def test_fingers_that_close_on_the_way_have_lost_the_object(closed, lost):
    # Base links close by 0.1 rad: 0.05 rad on average of base and tip.
    world = World(max_attempts=1)
    hold, world.where = world.base_angle, lambda mode: [blob(START)]
    slips = (Mode.TRANSFER, Mode.PLACE)
    world.base_angle = lambda mode: hold(mode) + (closed if mode in slips else 0.0)
    status = world.run()
    assert (status.failure is Failure.DROPPED) == lost
    assert (Mode.PLACE in world.trace) != lost


def test_a_sensor_that_fails_for_a_moment_changes_nothing():
    world = World(slip_time=0.05)
    world.holding = lambda mode: (
        mode is not Mode.TRANSFER or world.time - world.began[mode] > 0.04
    )
    assert world.run().attempts == 1
    assert world.trace == CYCLE


def test_an_object_dropped_onto_its_goal_is_placed():
    world = World(slip_time=0.03)
    losing_in(Mode.PLACE, world)
    placed_in(world)
    status = world.run()
    assert (status.mode, status.failure, status.attempts) == (Mode.DONE, None, 1)
    assert (status.cycles, status.message) == (1, "")


def test_the_task_planner_learns_which_grasps_failed_in_this_cycle():
    world = World(repeat=2)
    losing_in(Mode.LIFT, world)
    placed_in(world)
    world.run()
    name = world.task_planner.grasp.name
    tried = [call[5] for call in world.task_planner.calls]
    assert tried[:3] == [(), (name,), ()]


@pytest.mark.parametrize(("rate", "lost"), [(0.1, False), (1.0, True)])
def test_fingers_that_settle_slowly_lose_nothing(rate, lost):
    world = World(max_attempts=1)
    hold, began = world.base_angle, world.began
    placed_in(world)

    def closing(mode):
        if mode not in CARRYING:
            return hold(mode)
        since = world.time - began.get(Mode.LIFT, world.time)
        return hold(mode) + min(2.0 * rate * since, 0.11)

    world.base_angle = closing
    assert (world.run().failure is Failure.DROPPED) == lost


# Real grasps.


def test_after_a_failure_another_grasp_is_tried_more_firmly(planner):
    search = planner._search
    ends = [RigidTransform(START), CAN, RigidTransform([0.55, -0.42, 0.05])]
    first, _ = search.candidates(*ends)
    names = [candidate.grasp.name for candidate in first]
    again, _ = search.candidates(*ends, tried=2 * names[:1])
    assert again[0].grasp.name != names[0]
    assert set(names) == {c.grasp.name for c in again}
    firm = {c.grasp.name: c.grasp.closure_closed for c in again}
    for candidate in first:
        assert firm[candidate.grasp.name] > candidate.grasp.closure_closed
    assert isinstance(planner.plan(planner.q_home, *ends, (), names), TaskMotions)
