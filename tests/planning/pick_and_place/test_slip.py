"""Objects that slip out of the hand on the way."""

import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.planning.grasps.grasps import GraspSearch
from drake_srg.planning.pick_and_place.task_motions import TaskMotions
from drake_srg.types import Cylinder, Failure, Mode
from planning.planning_world import CYCLE, GOAL, START, World, blob

ESCAPE = [Mode.RELEASE, Mode.RETREAT, Mode.HOME]
CARRYING = [Mode.LIFT, Mode.TRANSFER, Mode.PLACE]
_STOP = 0.4  # duration of a stop in the middle of a motion [s]


def losing_in(mode, world, attempts=1):
    """Let the first attempts lose the object in a mode; it is back at its start."""
    before = CYCLE[: CYCLE.index(mode)]
    world.holding = lambda now: now in before or world.status.attempts > attempts
    world.where = lambda now: [
        blob(GOAL if now is Mode.HOME and world.status.attempts > attempts else START)
    ]


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
    status = world.run()
    assert (status.mode, status.failure) == (Mode.FAILED, Failure.DROPPED)
    assert "got lost" in status.message
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
    world.where = lambda mode: [
        blob(START if Mode.PLACE not in world.trace else GOAL),
    ]
    status = world.run()
    assert (status.mode, status.failure, status.attempts) == (Mode.DONE, None, 1)
    assert (status.cycles, status.message) == (1, "")


def test_the_task_planner_learns_which_grasps_failed_in_this_cycle():
    world = World(repeat=2)
    losing_in(Mode.LIFT, world)
    tried, plan = [], world.task_planner.plan

    def recorded(*args):
        tried.append(args[5])
        return plan(*args)

    world.task_planner.plan = recorded
    world.where = lambda mode: [blob(START if Mode.PLACE not in world.trace else GOAL)]
    world.run()
    name = world.task_planner.grasp.name
    assert tried[:2] == [(), (name,)]
    assert tried[2] == ()


@pytest.mark.parametrize(("rate", "lost"), [(0.1, False), (1.0, True)])
def test_fingers_that_settle_slowly_lose_nothing(rate, lost):
    world = World(max_attempts=1)
    hold, began = world.base_angle, world.began
    world.where = lambda mode: [blob(START if Mode.PLACE not in world.trace else GOAL)]

    def closing(mode):
        if mode not in CARRYING:
            return hold(mode)
        since = world.time - began.get(Mode.LIFT, world.time)
        return hold(mode) + min(2.0 * rate * since, 0.11)

    world.base_angle = closing
    assert (world.run().failure is Failure.DROPPED) == lost


# Real grasps.


def test_after_a_failure_another_grasp_is_tried_more_firmly(planner):
    config, can = planner.config, Cylinder(0.034, 0.1)
    search = GraspSearch(
        planner.scene,
        planner.hand,
        planner.q_home,
        place_height=config.place_height,
    )
    ends = [RigidTransform(START), can, RigidTransform([0.55, -0.42, 0.05])]
    first, _ = search.candidates(*ends)
    names = [candidate.grasp.name for candidate in first]
    again, _ = search.candidates(*ends, tried=2 * names[:1])
    assert again[0].grasp.name != names[0]
    assert set(names) == {c.grasp.name for c in again}
    firm = {c.grasp.name: c.grasp.closure_closed for c in again}
    for candidate in first:
        assert firm[candidate.grasp.name] > candidate.grasp.closure_closed
    assert isinstance(planner.plan(planner.q_home, *ends, (), names), TaskMotions)
