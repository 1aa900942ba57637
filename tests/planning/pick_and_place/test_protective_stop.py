"""External torques that stop the arm: the planner alone, and in a cell."""

import numpy as np
import pytest
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.common.log_format import MODES
from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.types import Failure, Mode
from planning.planning_world import CYCLE, MOVING, World, make_planner


def feeling(world, torque, when):
    """Let the arm feel `torque` (2) [N m] in the modes `when`."""
    world.external_torque = lambda mode: torque if mode in when else [0.0, 0.0]
    return world


@pytest.mark.parametrize("mode", MOVING)
def test_a_moving_arm_stops_where_it_touches_something(mode):
    world = feeling(World(max_external_torque=[10.0, 5.0]), [4.0, -6.0], [mode])
    status = world.fail(Failure.STOPPED, "joint 2")
    assert world.trace == [*CYCLE[: CYCLE.index(mode) + 1], Mode.FAILED]
    assert "6 N m" in status.message
    # The arm stops and the task ends within two periods.
    assert world.time - world.began[mode] <= 2.0 * world.period
    np.testing.assert_array_equal(world.read("position_commanded"), world.commands[-2])


def slow_down(task_planner):
    """Extend planned placements by 5 mrad in another 50 ms."""
    plan = task_planner._motions

    def motions(q_start, modes):
        task = plan(q_start, modes)
        down = task.motions[Mode.PLACE]
        start, end = down.value(0.0), down.value(0.1)
        task.motions[Mode.PLACE] = PiecewisePolynomial.FirstOrderHold(
            [0.0, 0.1, 0.15], np.hstack([start, end + np.array([[0.005], [0.0]]), end])
        )
        return task

    task_planner._motions = motions


@pytest.mark.parametrize(("off", "ends"), [(0.01, Mode.DONE), (0.3, Mode.FAILED)])
def test_what_a_set_down_object_meets_at_the_end_of_its_path_is_its_goal(off, ends):
    # An object that hangs askew meets it early, with its edge.
    world = World(max_external_torque=[10.0, 5.0])
    slow_down(world.task_planner)
    q_goal = world.task_planner.q_home + np.array([2.0, 0.0])

    def torque(mode):
        away = np.max(np.abs(world.read("position_commanded") - q_goal))
        return [0.0, 6.0 if mode is Mode.PLACE and away < off else 0.0]

    world.external_torque = torque
    assert world.run().mode is ends


def test_torques_below_one_newton_metre_are_reported_unrounded():
    world = feeling(World(max_external_torque=[0.4, 0.5]), [0.45, 0.0], [Mode.TRANSFER])
    message = world.run().message
    assert "joint 1 feels 0.45 N m from outside (allowed: 0.4 N m)" in message


def test_an_arm_at_rest_may_feel_its_fingers():
    world = World(max_external_torque=[10.0, 5.0])
    still = [Mode.CLOSE, Mode.VERIFY, Mode.RELEASE]
    assert feeling(world, [99.0, 99.0], still).run().mode is Mode.DONE


def test_torques_within_the_limits_do_not_stop_the_arm():
    world = feeling(World(max_external_torque=[10.0, 5.0]), [9.0, -4.9], MOVING)
    assert world.run().mode is Mode.DONE


def test_without_limits_torques_do_not_matter():
    assert feeling(World(), [99.0, 99.0], MOVING).run().mode is Mode.DONE


def test_each_joint_needs_a_limit():
    with pytest.raises(ValueError, match=r"one entry per joint .* \(2\), got 3"):
        make_planner(max_external_torque=[1.0] * 3)


# A cell with an unknown post between object and goal.

_POST = (
    "objects.post={{shape: !Box {{size: [0.06, 0.2, {height}]}}, mass: 30.0, "
    "friction: 1.0, color: [0.3, 0.3, 0.3], position: [0.62, -0.22], known: false}}"
)


def run(limit, *overrides, name="kitchen_fast"):
    """Run a kitchen; `limit` is that of all joints [N m]."""
    scenario = load_scenario(
        name,
        seed=0,
        overrides=[
            "object.position=[0.6, 0.08]",
            f"planner.max_external_torque={[limit] * 7}",
            "planner.max_attempts=1",
            "planner.time_budget=12",
            *overrides,
        ],
    )
    return Simulate(scenario)


def collision(limit, *overrides, height=0.4, seen=False, name="kitchen_fast"):
    """Run with a post, `height` [m] high, that the cameras may see."""
    post = _POST.format(height=height)
    seen = f"localizer.obstacles={str(seen).lower()}"
    return run(limit, post, seen, *overrides, name=name)


@pytest.mark.slow
def test_an_arm_that_hits_a_post_stops():
    stopped, going_on = collision(30.0), collision(1e4)
    assert stopped.metrics.failure == "stopped"
    assert "the arm touches something" in stopped.status.message
    # With an unreachable limit, it fails only because the arm does not arrive.
    assert "the arm touches something" not in going_on.status.message
    moved = [
        np.linalg.norm(np.diff(result.log["object_pose.post"][[0, -1], :2], axis=0))
        for result in (stopped, going_on)
    ]
    # The post weighs 30 kg and slides; an arm that goes on tips it over.
    assert moved[0] < 0.2 * moved[1]
    # The arm met it at 1 rad/s. It does not press on, though the post still rocks.
    speeds = stopped.log["arm.state_measured"][-1, 7:]
    np.testing.assert_allclose(speeds, 0.0, atol=0.05)


@pytest.mark.slow
def test_an_arm_on_a_discrete_plant_stops_too():
    """There, external torques are estimated, not taken from the contacts."""
    longer_steps = ("plant_config.time_step=0.005", "arm.period=0.005")
    stopped = collision(30.0, *longer_steps, name="kitchen")
    assert stopped.metrics.failure == "stopped"
    speeds = stopped.log["arm.state_measured"][-1, 7:]
    np.testing.assert_allclose(speeds, 0.0, atol=0.05)


@pytest.mark.slow
def test_the_arm_passes_a_visible_post():
    passed = collision(30.0, height=0.25, seen=True)
    assert passed.metrics.success
    post = passed.log["object_pose.post"]
    # An untouched post only settles.
    np.testing.assert_allclose(post[-1, :3], post[0, :3], atol=1e-4)


# A load in the hand, with the fast physics.

_CARRYING = (Mode.LIFT, Mode.TRANSFER, Mode.PLACE)
_WEIGHT = 0.349 * 9.81  # of the can [N]
_FREE = 3.0 * _WEIGHT  # more than its torque at less than 1 m [N m]


@pytest.mark.slow
def test_the_arm_feels_the_weight_and_the_inertia_of_its_load():
    result = run(_FREE)
    assert result.metrics.success
    carrying = np.isin(result.log["mode"], [MODES.index(mode) for mode in _CARRYING])
    felt = result.log["arm.external_torque"][carrying]
    reach = np.linalg.norm(result.log["object_pose.soup_can"][carrying, :2], axis=1)
    # Gravity loads the shoulder's second joint; acceleration adds up to half of that.
    share = np.abs(felt[:, 1]) / (_WEIGHT * reach)
    assert np.median(share) == pytest.approx(1.0, abs=0.2)
    assert np.max(share) < 1.5


@pytest.mark.slow
def test_setting_the_object_down_on_something_unseen_stops_the_arm():
    plate = (
        "objects.plate={shape: !Box {size: [0.12, 0.12, 0.02]}, mass: 30.0, "
        "friction: 1.0, color: [0.3, 0.3, 0.3], position: [0.3, -0.5], known: false}"
    )
    stopped = run(_FREE, plate, "task.place.position=[0.3, -0.5]")
    assert stopped.metrics.failure == "stopped"


@pytest.mark.slow
def test_a_pull_on_the_held_object_stops_the_arm():
    pull = "{at: transfer, force: [0, 0, -15], duration: 0.3}"
    stopped = run(_FREE, f"disturbances=[!Force {pull}]")
    assert stopped.metrics.failure == "stopped"
