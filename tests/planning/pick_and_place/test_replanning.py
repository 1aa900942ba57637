"""The planner's reactions to sightings on the way."""

import dataclasses as dc

import numpy as np
import pytest

from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.types import BlobFlag, Failure, Mode
from planning.planning_world import CYCLE, GOAL, START, World, blob


def test_an_object_that_moved_during_the_approach_is_planned_for_again():
    world = World(look_before_grasp=True)
    moved = START + np.array([0.03, 0.0, 0.0])
    world.show(lambda: [blob(moved)], after=Mode.PRE_GRASP)
    status = world.run()
    assert world.trace == [Mode.IDLE, Mode.PRE_GRASP, *CYCLE]
    assert (status.failure, status.attempts) == (None, 1)
    first, second = world.task_planner.calls
    np.testing.assert_array_equal(second[1].translation(), moved)
    # The second plan begins where the first motion ended.
    np.testing.assert_allclose(second[0], first[0] + [1.0, 0.0])


@pytest.mark.parametrize("shift", [0.0, 0.002])
def test_an_object_that_hardly_moved_is_taken(shift):
    world = World(look_before_grasp=True)
    seen = blob(START + shift * np.eye(3)[0])
    world.show(lambda: [seen], modes=[Mode.PRE_GRASP])
    assert world.run().failure is None
    assert world.trace == CYCLE
    assert world.camera.evaluations == 3


def test_an_object_that_was_knocked_over_is_planned_for_again():
    world = World(look_before_grasp=True)
    lying = blob(START, axis=[0.0, 1.0, 0.0])
    world.show(lambda: [lying], after=Mode.PRE_GRASP)
    world.run()
    axis = world.task_planner.calls[1][1].rotation().col(2)
    np.testing.assert_allclose(axis, [0.0, 1.0, 0.0], atol=1e-12)


def test_an_object_that_never_stands_still_is_tried_in_the_end():
    world = World(look_before_grasp=True, max_attempts=2)
    moving = [mode for mode in CYCLE if mode is not Mode.HOME]
    world.show(lambda: [blob(START + 0.01 * world.time)], modes=moving)
    status = world.run()
    assert world.trace.count(Mode.PRE_GRASP) == 3  # two detours, then the grasp
    assert (status.mode, status.attempts) == (Mode.DONE, 1)


def test_without_a_plan_near_the_object_the_arm_plans_from_home():
    world = World(look_before_grasp=True)
    moved, plan = START + np.array([0.03, 0.0, 0.0]), world.task_planner.plan
    world.show(lambda: [blob(moved)], after=Mode.PRE_GRASP)

    def only_from_home(q_start, *args):
        if not np.array_equal(q_start, world.task_planner.q_home):
            return PlanningFailure(Failure.BLOCKED, "too near")
        return plan(q_start, *args)

    world.task_planner.plan = only_from_home
    status = world.run()
    way = [Mode.IDLE, Mode.PRE_GRASP, Mode.IDLE, Mode.RETREAT, Mode.HOME]
    assert world.trace == [*way, *CYCLE]
    assert (status.mode, status.failure, status.attempts) == (Mode.DONE, None, 1)


def test_placing_accounts_for_where_the_object_is_in_the_hand():
    world = World(look_before_place=True)
    grasp, shift = world.task_planner.grasp, np.array([0.002, -0.001, 0.001])
    world.show(lambda: [world.held(shift, sign=-1.0)], modes=[Mode.TRANSFER])
    status = world.run()
    assert status.failure is None
    ((_, corrected, _, goal),) = world.task_planner.places
    np.testing.assert_allclose(corrected.p_GO, grasp.p_GO + shift, atol=1e-12)
    # An axis has no sign.
    np.testing.assert_allclose(corrected.axis_G, grasp.axis_G, atol=1e-12)
    np.testing.assert_array_equal(goal.translation(), GOAL)
    waited = world.began[Mode.PLACE] - world.began[Mode.TRANSFER]
    assert waited >= 0.1 + world.planner.config.latency  # motion, then planning


@pytest.mark.parametrize("hidden", [False, True])
def test_a_look_alike_in_better_view_is_not_taken_for_the_held_object(hidden):
    world = World(look_before_place=True)
    grasp, shift = world.task_planner.grasp, np.array([0.002, -0.001, 0.001])
    flags = frozenset({BlobFlag.UNCERTAIN} if hidden else {})

    def seen():
        held = dc.replace(world.held(shift), misfit=0.6, flags=flags)
        return [blob(START), held]

    world.show(seen, modes=[Mode.TRANSFER])
    assert world.run().failure is None
    assert world.trace == CYCLE
    corrected = [place[1].p_GO for place in world.task_planner.places]
    expected = [] if hidden else [grasp.p_GO + shift]
    np.testing.assert_allclose(corrected, expected, atol=1e-12)


def test_an_object_hidden_in_the_hand_is_placed_as_planned():
    world = World(look_before_place=True)
    world.show(list, modes=[Mode.TRANSFER])
    assert world.run().failure is None
    assert world.task_planner.places == []


def test_a_new_failure_does_not_report_an_old_one():
    world = World(repeat=2, max_attempts=2)
    world.holding = lambda mode: world.status.attempts > 1 or mode is Mode.CLOSE
    there = world.where
    world.where = lambda mode: there(mode) if world.status.cycles == 0 else []
    status = world.run()
    assert (status.cycles, status.failure) == (1, Failure.NOT_SEEN)
    assert status.message == "no can in any image"


def test_every_cycle_has_the_whole_time_budget():
    alone = World()
    alone.run()
    world = World(repeat=3, time_budget=1.5 * alone.time)
    world.where = lambda mode: [
        blob(GOAL if (world.status.cycles + (mode is Mode.HOME)) % 2 else START)
    ]
    assert world.run().failure is None


def test_uncertain_blobs_on_the_way_change_nothing():
    world = World(look_before_grasp=True, look_before_place=True)
    there, flags = world.where, frozenset({BlobFlag.UNCERTAIN})
    world.where = lambda mode: [dc.replace(b, flags=flags) for b in there(mode)]
    assert world.run().failure is None
    assert world.trace == CYCLE
    assert world.task_planner.places == []


def test_an_object_seen_outside_the_hand_is_lost():
    world = World(look_before_place=True, max_attempts=1)
    world.where = lambda mode: [blob(START)]
    world.fail(Failure.DROPPED)
