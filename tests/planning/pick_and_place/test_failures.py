"""Tasks that fail, each for its reason."""

import numpy as np
import pytest

from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.types import Failure, Mode
from planning.planning_world import CYCLE, GOAL, START, World, blob

ESCAPE = [Mode.RELEASE, Mode.RETREAT, Mode.HOME]


def test_an_object_that_is_nowhere_is_given_up_after_the_search_time():
    world = World(search_time=0.5)
    world.where = lambda mode: []
    status = world.run()
    assert (status.mode, status.failure) == (Mode.FAILED, Failure.NOT_SEEN)
    assert world.camera.evaluations == status.looks == 3  # at 0, 0.25 and 0.5 s
    assert world.time == pytest.approx(0.5, abs=2 * world.period)
    assert "can" in status.message
    assert status.attempts == 0


@pytest.mark.parametrize("failure", [Failure.BLOCKED, Failure.OUT_OF_REACH])
def test_a_task_without_a_plan_fails_for_the_planner_s_reason(failure):
    world = World()
    world.task_planner.result = PlanningFailure(failure, "there is a wall")
    status = world.run()
    assert (status.mode, status.failure) == (Mode.FAILED, failure)
    assert status.message == "there is a wall"
    assert status.attempts == 0
    assert np.ptp(world.commands, axis=0).max() == 0.0


@pytest.mark.parametrize("attempts", [1, 2])
def test_the_task_fails_after_all_attempts_to_grasp(attempts):
    world = World(max_attempts=attempts)
    world.holding = lambda mode: False
    status = world.run()
    assert (status.mode, status.failure) == (Mode.FAILED, Failure.NO_GRASP)
    assert status.attempts == attempts
    assert Mode.LIFT not in world.trace
    assert "nothing of the right size" in status.message


@pytest.mark.parametrize("lost_in", [Mode.LIFT, Mode.TRANSFER])
def test_an_object_lost_on_the_way_is_dropped(lost_in):
    world = World(max_attempts=1)
    on_the_way = CYCLE[CYCLE.index(Mode.CLOSE) : CYCLE.index(lost_in)]
    world.holding = lambda mode: mode in on_the_way
    world.where = lambda mode: [blob(START)]
    status = world.run()
    assert (status.mode, status.failure) == (Mode.FAILED, Failure.DROPPED)
    assert world.trace[-5:] == [lost_in, *ESCAPE, Mode.FAILED]
    assert "got lost" in status.message


def test_a_dropped_object_that_is_not_seen_again_is_reported_as_dropped():
    world = World(max_attempts=2)
    world.holding = lambda mode: mode in (Mode.CLOSE, Mode.VERIFY)
    there = world.where
    world.where = lambda mode: there(mode) if world.status.attempts == 0 else []
    status = world.run()
    assert (status.failure, status.attempts) == (Failure.DROPPED, 1)


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
    assert world.run().failure is Failure.MISPLACED


def test_an_arm_that_does_not_arrive_fails_as_stopped():
    world = World(arrival_timeout=0.5)
    world.arm_follows = False
    status = world.run()
    assert (status.mode, status.failure) == (Mode.FAILED, Failure.STOPPED)
    assert world.trace == [Mode.IDLE, Mode.PRE_GRASP, Mode.FAILED]
    assert "in its way" in status.message


def test_a_spent_time_budget_ends_the_task():
    world = World(time_budget=0.3, latency=0.1)
    status = world.run()
    assert (status.mode, status.failure) == (Mode.FAILED, Failure.TIME_BUDGET)
    assert world.time == pytest.approx(0.3, abs=2 * world.period)
    assert "time budget" in status.message


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
    status = world.run()
    assert (status.mode, status.failure) == (Mode.FAILED, Failure.NO_GRASP)
    assert status.message == "stuck"
