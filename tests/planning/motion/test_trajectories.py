from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import MultibodyForces

from drake_srg.planning.motion.inverse_kinematics import (
    HandTarget,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.limits import MotionLimits
from drake_srg.planning.motion.paths import plan_cartesian_path, plan_joint_path
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.planning.motion.trajectories import time_optimal_trajectory
from drake_srg.types import Box, Failure

# Velocity and acceleration limits hold by construction, but for rounded sums.
ROUNDING = 1e-9
# Torque limits hold at the knots, 0.04 s apart. Between them the acceleration is
# linear, but gravity and Coriolis torques bend a little.
TORQUE_SLACK = 0.02
RAMP = 0.04

unit = st.floats(-1.0, 1.0)


def free_postures(scene, values):
    """Return free postures over the table, (k, N), from numbers in -1 .. 1."""
    middle = np.array([0.0, 0.2, 0.0, -1.5, 0.0, 1.2, 0.0])
    spread = np.array([1.5, 0.4, 0.5, 0.5, 1.0, 0.7, 1.5])
    postures = middle + spread * np.array(values).reshape(-1, 7)
    assume(all(map(scene.is_free, postures)))
    return postures


def sampled(trajectory, count=1000):
    """Return times, and q, v and a at these, each of shape (count, N)."""
    times = np.linspace(0.0, trajectory.end_time(), count)
    derivatives = [
        np.array([trajectory.EvalDerivative(t, order)[:, 0] for t in times])
        for order in range(3)
    ]
    return times, *derivatives


def trapezoid_time(q_1, q_2, limits):
    """Return the least time for a straight joint line within the limits [s]."""
    move = np.abs(q_2 - q_1)
    if np.max(move) < 1e-6:
        return 0.0
    with np.errstate(divide="ignore", over="ignore"):
        v, a = np.min(limits.velocity / move), np.min(limits.acceleration / move)
    return 1.0 / v + v / a if v * v / a < 1.0 else 2.0 / np.sqrt(a)


def torques_of(scene, q, v, a):
    """Return the joint torques of the motion, of the shape of q [N m]."""
    plant, context = scene.plant, scene.plant.CreateDefaultContext()
    torques = []
    for q_i, v_i, a_i in zip(q, v, a, strict=True):
        full = np.zeros((2, plant.num_velocities()))
        full[:, scene.arm_indices] = v_i, a_i
        plant.SetPositions(context, scene.positions(q_i))
        plant.SetVelocities(context, full[0])
        forces = MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        tau = plant.CalcInverseDynamics(context, full[1], forces)
        torques.append(tau[scene.arm_indices])
    return np.array(torques)


def assert_within(scene, trajectory, limits):
    _, q, v, a = sampled(trajectory)
    assert np.all(np.abs(v) <= limits.velocity * (1.0 + ROUNDING))
    assert np.all(np.abs(a) <= limits.acceleration * (1.0 + ROUNDING))
    tau = torques_of(scene, q[::10], v[::10], a[::10])
    assert np.all(np.abs(tau) <= limits.torque * (1.0 + TORQUE_SLACK))
    assert trajectory.start_time() == 0.0
    # It begins and ends at rest, without acceleration.
    for x in (v[0], v[-1], a[0], a[-1]):
        np.testing.assert_allclose(x, 0.0, atol=1e-9)


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(st.lists(unit, min_size=14, max_size=14))
def test_straight_lines_keep_the_limits_and_take_little_longer_than_a_trapezoid(
    iiwa, values
):
    q_1, q_2 = free_postures(iiwa, values)
    assume(np.max(np.abs(q_2 - q_1)) > 0.05)
    limits = MotionLimits.of_plant(iiwa)
    trajectory = time_optimal_trajectory(iiwa, np.array([q_1, q_2]), limits)
    assert_within(iiwa, trajectory, limits)
    _, q, _, _ = sampled(trajectory)
    np.testing.assert_allclose(q[[0, -1]], [q_1, q_2], atol=1e-12)
    along = (q - q_1) @ (q_2 - q_1) / np.sum((q_2 - q_1) ** 2)
    np.testing.assert_allclose(q, q_1 + along[:, None] * (q_2 - q_1), atol=1e-9)
    assert np.all(np.diff(along) >= -1e-9)
    # The ramps cost two intervals, TOPP-RA's grid a little.
    fastest = trapezoid_time(q_1, q_2, limits)
    assert fastest <= trajectory.end_time() <= 1.03 * fastest + 2.2 * RAMP


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(st.lists(unit, min_size=28, max_size=28), st.sampled_from([0.02, 0.2]))
def test_polylines_keep_the_limits_stay_near_and_are_no_slower_than_stopping(
    iiwa, values, rounding
):
    waypoints = free_postures(iiwa, values)
    edges = list(itertools.pairwise(waypoints))
    assume(all(iiwa.is_edge_free(*edge) for edge in edges))
    limits = MotionLimits.of_plant(iiwa)
    trajectory = time_optimal_trajectory(iiwa, waypoints, limits, rounding=rounding)
    assert_within(iiwa, trajectory, limits)
    _, q, _, _ = sampled(trajectory)
    np.testing.assert_allclose(q[[0, -1]], waypoints[[0, -1]], atol=1e-12)
    distances = np.min([distance_to_segment(q, *edge) for edge in edges], axis=0)
    # The ramps blur the path by another 0.04^2 / 6 s^2 of the acceleration.
    assert np.max(distances) <= rounding + 0.01
    assert all(iiwa.clearance(x).spare >= -0.002 for x in q[::5])
    ways = np.diff(waypoints, axis=0)
    if rounding == 0.2 and np.all(np.sum(ways[:-1] * ways[1:], axis=1) >= 0.0):
        # Going on is faster than stopping, unless a corner turns back sharply.
        stopping = sum(trapezoid_time(*edge, limits) + 2 * RAMP for edge in edges)
        assert trajectory.end_time() <= stopping


def distance_to_segment(q, q_1, q_2):
    way = q_2 - q_1
    share = np.clip((q - q_1) @ way / max(way @ way, 1e-12), 0.0, 1.0)
    return np.linalg.norm(q - q_1 - share[:, None] * way, axis=1)


def test_a_way_around_a_wall_stays_free_when_rounded(iiwa, home):
    down = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    left, right = (
        solve_inverse_kinematics(
            iiwa,
            HandTarget(np.array([0.55, y, 0.3]), RotationMatrix(down)),
            q_nominal=home,
        ).q
        for y in (-0.3, 0.3)
    )
    limits = MotionLimits.of_plant(iiwa)
    with iiwa.standing(Box((0.3, 0.03, 0.5)), RigidTransform([0.6, 0.0, 0.25])):
        path = plan_joint_path(iiwa, left, right)
        trajectory = time_optimal_trajectory(iiwa, path, limits)
        again = time_optimal_trajectory(iiwa, path, limits)
        _, q, _, _ = sampled(trajectory)
        # The margin may be broken by 1 mm, and by another 1 mm between checks.
        assert min(iiwa.clearance(x).spare for x in q) >= -0.002
    assert_within(iiwa, trajectory, limits)
    for first, second in zip(
        trajectory.control_points(), again.control_points(), strict=True
    ):
        np.testing.assert_array_equal(first, second)


def test_a_timed_line_of_the_hand_stays_a_line(iiwa, home):
    X_start = iiwa.X_WG(home)
    target = HandTarget.from_pose(X_start).shifted(np.array([0.1, 0.05, -0.1]))
    path = plan_cartesian_path(iiwa, home, target)
    limits = MotionLimits.of_plant(iiwa).scaled(acceleration=0.5)
    trajectory = time_optimal_trajectory(iiwa, path, limits, rounding=1e-3)
    way = target.p_WT - X_start.translation()
    way /= np.linalg.norm(way)
    for q in sampled(trajectory, 100)[1]:
        offset = iiwa.X_WG(q).translation() - X_start.translation()
        # Rounding is 1e-3 rad, at up to 1 m from the joint that turns.
        assert np.linalg.norm(offset - (offset @ way) * way) < 1e-3
    assert_within(iiwa, trajectory, limits)


def test_a_motion_leaves_each_line_by_as_much_as_is_allowed_there(iiwa, home):
    aside, up = np.zeros(7), np.zeros(7)
    aside[0], up[1] = 0.6, -0.6
    corner = home + aside
    waypoints = np.array([home, home + 0.75 * aside, corner, corner + up])
    limits = MotionLimits.of_plant(iiwa)

    def deviation(rounding):
        """Return how far the motion is from the corner, and from the first line."""
        _, q, _, _ = sampled(
            time_optimal_trajectory(iiwa, waypoints, limits, rounding=rounding)
        )
        first = q[q[:, 0] < waypoints[1, 0]]
        off_corner = np.min(np.linalg.norm(q - corner, axis=1))
        return off_corner, np.max(np.abs(first[:, 1] - home[1]))

    loose, held = deviation(0.2), deviation(np.array([1e-3, 1e-3, 0.2, 0.2]))
    assert 0.02 < held[0] < 0.2
    assert held[1] < 3e-3 < loose[1]
    assert deviation(np.full(4, 0.02))[0] < held[0]


def test_a_ramp_limits_the_jerk(iiwa, home):
    limits = MotionLimits.of_plant(iiwa)
    waypoints = np.array([home, home + 0.5])
    times, _, _, a = sampled(time_optimal_trajectory(iiwa, waypoints, limits))
    jerk = np.abs(np.diff(a, axis=0)) / np.diff(times)[:, None]
    # At worst, acceleration goes from one limit to the other within a ramp. The motion
    # is divided into a whole number of ramps, which may be shorter.
    assert np.all(jerk <= 2.5 * limits.acceleration / RAMP)


def test_standing_still_takes_no_more_than_two_ramps(iiwa, home):
    trajectory = time_optimal_trajectory(
        iiwa, np.array([home, home]), MotionLimits.of_plant(iiwa)
    )
    assert trajectory.end_time() == pytest.approx(2 * RAMP)
    _, q, v, _ = sampled(trajectory, 5)
    np.testing.assert_allclose(q, [home] * 5)
    np.testing.assert_allclose(v, 0.0, atol=1e-12)


def test_limits_are_those_of_the_model(pendulum):
    limits = MotionLimits.of_plant(pendulum)
    np.testing.assert_allclose(limits.velocity, [2.0, 3.0])
    np.testing.assert_allclose(limits.acceleration, [10.0, 20.0])
    np.testing.assert_allclose(limits.torque, [13.0, 13.0])


def test_the_torque_limit_slows_an_arm_that_lifts_a_weight(pendulum):
    # Level, 2 kg at 0.5 m take 9.81 N m to hold; of 13 N m, 3.2 are left to lift.
    # About y, a negative angle is up.
    waypoints = np.array([[0.0, 0.0], [-0.4, 0.0]])
    limits = MotionLimits.of_plant(pendulum)
    strong = MotionLimits(limits.velocity, limits.acceleration, np.full(2, 1e3))
    lifting = time_optimal_trajectory(pendulum, waypoints, limits)
    unlimited = time_optimal_trajectory(pendulum, waypoints, strong)
    assert lifting.end_time() > unlimited.end_time() + 0.02
    assert_within(pendulum, lifting, limits)
    _, q, v, a = sampled(unlimited)
    assert np.max(np.abs(torques_of(pendulum, q, v, a))) > 1.05 * 13.0


def test_a_weight_too_heavy_to_hold_is_out_of_reach(pendulum):
    limits = MotionLimits.of_plant(pendulum).scaled(torque=0.6)  # 7.8 of 9.81 N m
    failure = time_optimal_trajectory(
        pendulum, np.array([[0.0, 0.0], [-0.2, 0.0]]), limits
    )
    assert isinstance(failure, PlanningFailure)
    assert failure.failure is Failure.OUT_OF_REACH
    assert "torque" in failure.message


def test_a_payload_slows_the_arm_and_can_be_too_heavy(pendulum, loaded_pendulum):
    waypoints = np.array([[0.0, 0.0], [-0.4, 0.0]])
    limits = MotionLimits.of_plant(pendulum)
    bare = time_optimal_trajectory(pendulum, waypoints, limits)
    loaded = time_optimal_trajectory(loaded_pendulum, waypoints, limits)
    assert loaded.end_time() > bare.end_time() + 0.02
    # 12.26 N m to hold 2.5 kg, 9.81 N m to hold 2 kg.
    weak = limits.scaled(torque=12.0 / 13.0)
    assert not isinstance(
        time_optimal_trajectory(pendulum, waypoints, weak), PlanningFailure
    )
    assert isinstance(
        time_optimal_trajectory(loaded_pendulum, waypoints, weak), PlanningFailure
    )


@pytest.mark.parametrize(
    ("waypoints", "changes", "message"),
    [
        (np.zeros(7), {}, "shape"),
        (np.zeros((2, 6)), {}, "shape"),
        (np.zeros((2, 7)), {"rounding": 0.0}, "positive"),
        (np.zeros((2, 7)), {"rounding": np.array([0.1, -0.1])}, "positive"),
    ],
)
def test_invalid_arguments_are_refused(iiwa, waypoints, changes, message):
    with pytest.raises(ValueError, match=message):
        time_optimal_trajectory(iiwa, waypoints, MotionLimits.of_plant(iiwa), **changes)
