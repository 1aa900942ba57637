from time import sleep

import numpy as np
import pytest

from drake_srg.planning.grasps.srg_hand import EMPTY_BASE_ANGLE
from drake_srg.planning.planner_machine import planning_clock
from drake_srg.types import Mode
from planning.planning_world import CYCLE, GOAL, START, World, blob

ESCAPE = [Mode.RELEASE, Mode.RETREAT, Mode.HOME]


def test_a_smooth_cycle_goes_through_all_modes():
    world = World()
    status = world.run()
    assert world.trace == CYCLE
    assert (status.failure, status.attempts, status.message) == (None, 1, "")
    assert status.localization is world.seen[0]
    # The last look is at the object on its goal.
    assert status.sighting is world.seen[-1]
    assert status.sighted_at > status.localized_at
    (call,) = world.task_planner.calls
    np.testing.assert_array_equal(call[0], world.task_planner.q_home)
    np.testing.assert_array_equal(call[1].translation(), START)


def test_the_fingers_close_on_the_object_and_open_to_release_it():
    world = World()
    world.run()
    grasp = world.task_planner.grasp
    for mode, closure in world.closures.items():
        closed = Mode.CLOSE.value, Mode.VERIFY.value, Mode.LIFT.value
        closed += Mode.TRANSFER.value, Mode.PLACE.value
        if mode is Mode.IDLE:
            assert closure == 0.0
        elif mode.value in closed:
            assert closure == grasp.closure_closed
        else:
            assert closure == grasp.closure_open


def test_the_commanded_position_never_jumps():
    world = World(max_attempts=2)
    world.holding = lambda mode: world.status.attempts == 2
    world.run()
    # The fake motions move 1 rad in 0.1 s, so 0.1 rad a period.
    steps = np.abs(np.diff(world.commands, axis=0))
    assert 0.09 < np.max(steps) <= 0.1 + 1e-9
    np.testing.assert_array_equal(world.commands[-1], world.task_planner.q_home)


def test_planning_takes_simulated_time():
    for latency in (0.0, 0.1, 0.35):
        world = World(latency=latency)
        world.run()
        begun = world.began[Mode.PRE_GRASP]
        # At most two updates lie between the decision and the motion.
        assert latency <= begun + 1e-9 <= latency + 2 * world.period


def test_the_simulation_may_begin_at_any_time():
    world = World(start=100.0, time_budget=10.0)
    assert world.run().mode is Mode.DONE
    assert world.status.localized_at == 100.0


def test_cameras_are_evaluated_only_when_the_planner_looks():
    world = World()
    status = world.run()
    # Once before the grasp and once at home, to see the object on its goal.
    assert world.camera.evaluations == 2
    assert status.looks == 2
    assert status.blobs == tuple(world.seen[-1:])  # passed on, without another look


def test_an_object_that_appears_later_is_found():
    world = World(search_time=0.5)
    late = world.where
    world.where = lambda mode: late(mode) if world.time > 0.1 else []
    status = world.run()
    assert status.mode is Mode.DONE
    assert status.localized_at == pytest.approx(0.25, abs=world.period)


def test_after_a_failed_grasp_the_arm_escapes_and_tries_again():
    world = World(max_attempts=3)
    world.holding = lambda mode: world.status.attempts == 2
    status = world.run()
    assert world.trace == [*CYCLE[:5], *ESCAPE, *CYCLE]
    assert (status.mode, status.failure, status.attempts) == (Mode.DONE, None, 2)
    assert len(world.task_planner.calls) == 2
    # The escape is planned for open fingers.
    assert world.task_planner.fingers == world.task_planner.grasp.fingers_open


@pytest.mark.parametrize(("share", "held"), [(0.4, True), (0.6, False), (1.0, False)])
def test_fingers_that_close_too_far_hold_nothing(share, held):
    """Close by a share of the way from contact to the angle of an empty hand."""
    world = World(max_attempts=1)
    expected = world.task_planner.grasp.base_angle
    angle = (1.0 - share) * expected + share * EMPTY_BASE_ANGLE
    world.base_angle = lambda mode: angle
    assert (world.run().failure is None) == held
    assert (Mode.LIFT in world.trace) == held


def test_planning_an_escape_takes_the_latency():
    world = World(latency=0.4, max_attempts=1)
    world.holding = lambda mode: False
    world.run()
    waited = world.began[Mode.RETREAT] - world.began[Mode.RELEASE]
    assert waited >= 0.4 - world.period


def test_how_long_planning_takes_on_the_wall_clock_is_told_beside_the_simulation():
    """Equal runs give equal states and reports, however fast the computer is."""
    quick, slow = World(), World()
    plan = slow.task_planner.plan

    def plan_slowly(*arguments):
        sleep(0.01)
        return plan(*arguments)

    slow.task_planner.plan = plan_slowly
    before = planning_clock()
    assert repr(slow.run()) == repr(quick.run())
    assert planning_clock() - before >= 0.01


def test_the_first_localisation_is_reported():
    world = World(max_attempts=2)
    world.holding = lambda mode: world.status.attempts > 1
    status = world.run()
    assert (status.failure, status.attempts) == (None, 2)
    assert status.localized_at == 0.0


def test_all_state_is_in_the_context():
    first = World()
    second = World(like=first)
    assert first.run().mode is Mode.DONE
    assert second.status.mode is Mode.IDLE
    assert second.run().mode is Mode.DONE
    np.testing.assert_array_equal(first.commands, second.commands)


def test_every_second_cycle_takes_the_object_back():
    world = World(repeat=3)
    world.where = lambda mode: [
        blob(GOAL if (world.status.cycles + (mode is Mode.HOME)) % 2 else START)
    ]
    status = world.run()
    assert (status.cycles, status.attempts) == (3, 3)
    assert world.trace == [*CYCLE[:-1], *CYCLE[:-1], *CYCLE]
    goals = [call[3].translation() for call in world.task_planner.calls]
    np.testing.assert_array_equal(goals[0], GOAL)
    np.testing.assert_allclose(goals[1], [*START[:2], 0.05])
    np.testing.assert_array_equal(goals[2], GOAL)


def test_the_waits_are_kept():
    waits = {"grip_wait": 0.5, "release_wait": 0.4, "home_wait": 0.3}
    world = World(**waits, close_at_home=0.2)
    world.run()
    began, slack = world.began, 2 * world.period
    assert began[Mode.LIFT] - began[Mode.VERIFY] == pytest.approx(0.5, abs=slack)
    assert began[Mode.RETREAT] - began[Mode.RELEASE] == pytest.approx(0.4, abs=slack)
    # The fake motion takes 0.1 s.
    assert began[Mode.DONE] - began[Mode.HOME] == pytest.approx(0.6, abs=slack)
    assert world.closures[Mode.RETREAT] < 1.0
    assert world.closures[Mode.HOME] == world.closures[Mode.DONE] == 1.0
