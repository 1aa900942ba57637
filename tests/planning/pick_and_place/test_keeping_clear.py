"""Keeping clear of obstacles: the planner in its world, and real motions."""

import dataclasses as dc

import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeTaskPlanner
from drake_srg.types import BlobFlag, Box, Failure, Mode, Obstacle
from planning.planning_world import CAN, CYCLE, START, World, blob

WALL = Obstacle(Box([0.1, 0.02, 0.3]), RigidTransform([0.5, 0.3, 0.15]))
AWAY = Obstacle(Box([0.05, 0.05, 0.1]), RigidTransform([0.4, -0.3, 0.05]))


# The planner in its world.


def test_visible_obstacles_are_planned_around():
    world = World()
    world.unknown = lambda mode: [WALL]
    assert world.run().mode is Mode.DONE
    assert world.task_planner.obstacles == ((WALL.shape, WALL.X_WO),)


def test_an_obstacle_that_appears_during_the_approach_is_planned_around():
    world = World(look_before_grasp=True)
    world.unknown = lambda mode: [WALL] if Mode.PRE_GRASP in world.trace else []
    world.task_planner.hit = "lift: palm and obstacle"
    status = world.run()
    # The fake reports every motion as blocked. After three detours, the planner goes.
    assert world.trace.count(Mode.PRE_GRASP) == 4
    assert (status.mode, status.attempts) == (Mode.DONE, 1)
    calls = [call[4] for call in world.task_planner.calls]
    assert calls[0] == ()
    assert all((WALL.shape, WALL.X_WO) in obstacles for obstacles in calls[1:])
    assert world.task_planner.checked[0] is Mode.GRASP


def test_an_obstacle_out_of_the_way_changes_nothing():
    world = World(look_before_grasp=True)
    world.unknown = lambda mode: [AWAY]
    assert world.run().mode is Mode.DONE
    assert world.trace == CYCLE


def test_an_obstacle_that_the_arm_may_hide_is_remembered():
    world = World(look_before_grasp=True)
    moved = blob(START + np.array([0.03, 0.0, 0.0]))
    world.unknown = lambda mode: [WALL] if Mode.PRE_GRASP not in world.trace else []
    world.show(lambda: [moved], after=Mode.PRE_GRASP)
    assert world.run().mode is Mode.DONE
    calls = [call[4] for call in world.task_planner.calls]
    assert calls == [((WALL.shape, WALL.X_WO),)] * 2


@pytest.mark.parametrize("hidden", [False, True])
def test_an_obstacle_that_appears_on_the_goal_blocks_it(hidden):
    world = World(look_before_place=True)
    flags = frozenset({BlobFlag.UNCERTAIN} if hidden else {})
    world.show(lambda: [dc.replace(world.held(), flags=flags)], modes=[Mode.TRANSFER])
    world.unknown = lambda mode: [WALL] if mode is Mode.TRANSFER else []
    world.task_planner.hit = "place: held_object and obstacle"
    world.task_planner.place = PlanningFailure(Failure.BLOCKED, "no")
    world.fail(Failure.BLOCKED, world.task_planner.hit)
    assert world.trace[-2] is Mode.TRANSFER


def test_a_look_alike_inside_the_table_is_an_obstacle():
    world = World()
    seen = [blob([0.5, 0.2, 0.03], quality=0.95), blob(START, quality=0.5)]
    around = Obstacle(Box([0.07, 0.07, 0.1]), RigidTransform(START))
    world.show(lambda: seen, modes=[Mode.IDLE])
    world.unknown = lambda mode: [around]
    assert world.run().localization is seen[1]
    ((shape, X_WO),) = world.task_planner.obstacles
    assert shape == CAN
    np.testing.assert_array_equal(X_WO.translation(), seen[0].position)


# Real motions.


@pytest.fixture(scope="module")
def planner():
    return MakeTaskPlanner(load_scenario("kitchen_fast"))


def cage(*angles):
    """Return walls as high as the can, 9 cm beside it, at angles in degrees."""
    walls = []
    for angle in np.deg2rad(angles):
        aside = 0.09 * np.array([np.cos(angle), np.sin(angle), 0.0])
        walls.append(
            (Box([0.03, 0.03, 0.16]), RigidTransform(0.03 * UP + START + aside))
        )
    return walls


UP = np.array([0.0, 0.0, 1.0])
HERE, THERE = RigidTransform(START), RigidTransform([0.55, -0.42, 0.05])


@pytest.mark.parametrize("turn", [0, 30, 60])
def test_the_hand_turns_until_it_fits_between_obstacles(planner, turn):
    walls = cage(turn, turn + 90, turn + 180)
    task = planner.plan(planner.q_home, HERE, CAN, THERE, walls)
    assert not isinstance(task, PlanningFailure), task.message
    assert planner.obstruction(task, CAN, walls) is None


def test_an_obstacle_on_the_way_is_named(planner):
    task = planner.plan(planner.q_home, HERE, CAN, THERE)
    motion = task.motions[Mode.TRANSFER]
    q = motion.value(0.5 * motion.end_time())[:, 0]
    X_WO = planner.scene.X_WG(q) @ task.grasp.X_GO
    hit = planner.obstruction(task, CAN, [(Box([0.05, 0.05, 0.05]), X_WO)])
    assert hit.startswith("transfer: ")
    assert "obstacle" in hit


def test_the_arm_is_not_its_own_obstacle(planner):
    q = planner.q_home
    around_hand = (Box([0.1, 0.1, 0.1]), planner.scene.X_WG(q))
    aside = (AWAY.shape, AWAY.X_WO)
    assert planner.others(q, {}, [around_hand, aside]) == (aside,)
    assert planner.scene.touches(q, *around_hand)


@pytest.mark.parametrize(("gap", "itself"), [(0.005, True), (0.1, False)])
def test_a_speck_just_beside_the_hand_is_the_hand(planner, gap, itself):
    """Images show the rim of a finger a few pixels off."""
    q, X_WG = planner.q_home, planner.scene.X_WG(planner.q_home)

    def speck(y):
        return Box([0.004] * 3), X_WG @ RigidTransform([0.05, y, 0.0])

    planner.scene.SetFingers({})
    # How far the hand reaches along the palm's y.
    side = next(
        y for y in np.arange(0.3, 0.0, -0.0005) if planner.scene.touches(q, *speck(y))
    )
    beside = speck(side + gap)
    assert not planner.scene.touches(q, *beside)
    assert planner.others(q, {}, [beside]) == (() if itself else (beside,))


@pytest.mark.parametrize(
    ("height", "rests"),
    [(0.0, True), (0.002, True), (-0.002, True), (0.008, False), (-0.006, False)],
)
def test_an_object_rests_on_the_table_within_tolerance(planner, height, rests):
    assert planner.rests(CAN, RigidTransform(START + height * UP)) == rests


def test_an_occupied_goal_blocks_the_plan(planner):
    taken = (Box([0.05, 0.05, 0.1]), THERE)
    task = planner.plan(planner.q_home, HERE, CAN, THERE, [taken])
    assert task.failure is Failure.BLOCKED
    assert "the goal is taken" in task.message
