"""Time-optimal motions, and motions within limits of the tip."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import MultibodyForces

from drake_srg.planning.motion.inverse_kinematics import HandTarget
from drake_srg.planning.motion.limits import MotionLimits, TipLimits
from drake_srg.planning.motion.paths import plan_cartesian_path, plan_joint_path
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.planning.motion.trajectories import (
    time_optimal_trajectory,
    tip_limited_trajectory,
)
from drake_srg.types import Failure, Sphere
from planning.pick_and_place.kitchen_task import assert_fails

# Velocity and acceleration limits hold by construction, but for rounded sums.
ROUNDING = 1e-9
# Torque limits hold at the knots, 0.04 s apart. Between them the acceleration is
# linear, but gravity and Coriolis torques bend a little.
TORQUE_SLACK = 0.02
RAMP = 0.04

limits_of = MotionLimits.of_plant
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
    limits = limits_of(iiwa)
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
    limits = limits_of(iiwa)
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


@pytest.mark.usefixtures("wall")
def test_a_way_around_a_wall_stays_free_when_rounded(iiwa, sides):
    limits = limits_of(iiwa)
    path = plan_joint_path(iiwa, *sides)
    trajectory, again = (time_optimal_trajectory(iiwa, path, limits) for _ in range(2))
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
    limits = limits_of(iiwa).scaled(acceleration=0.5)
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
    limits = limits_of(iiwa)

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
    limits = limits_of(iiwa)
    waypoints = np.array([home, home + 0.5])
    times, _, _, a = sampled(time_optimal_trajectory(iiwa, waypoints, limits))
    jerk = np.abs(np.diff(a, axis=0)) / np.diff(times)[:, None]
    # At worst, acceleration goes from one limit to the other within a ramp. The motion
    # is divided into a whole number of ramps, which may be shorter.
    assert np.all(jerk <= 2.5 * limits.acceleration / RAMP)


def test_standing_still_takes_no_more_than_two_ramps(iiwa, home):
    trajectory = time_optimal_trajectory(iiwa, np.array([home, home]), limits_of(iiwa))
    assert trajectory.end_time() == pytest.approx(2 * RAMP)
    _, q, v, _ = sampled(trajectory, 5)
    np.testing.assert_allclose(q, [home] * 5)
    np.testing.assert_allclose(v, 0.0, atol=1e-12)


def test_limits_are_those_of_the_model(pendulum):
    limits = limits_of(pendulum)
    np.testing.assert_allclose(limits.velocity, [2.0, 3.0])
    np.testing.assert_allclose(limits.acceleration, [10.0, 20.0])
    np.testing.assert_allclose(limits.torque, [13.0, 13.0])


def test_the_torque_limit_slows_an_arm_that_lifts_a_weight(pendulum):
    # Level, 2 kg at 0.5 m take 9.81 N m to hold; of 13 N m, 3.2 are left to lift.
    # About y, a negative angle is up.
    waypoints = np.array([[0.0, 0.0], [-0.4, 0.0]])
    limits = limits_of(pendulum)
    strong = MotionLimits(limits.velocity, limits.acceleration, np.full(2, 1e3))
    lifting = time_optimal_trajectory(pendulum, waypoints, limits)
    unlimited = time_optimal_trajectory(pendulum, waypoints, strong)
    assert lifting.end_time() > unlimited.end_time() + 0.02
    assert_within(pendulum, lifting, limits)
    _, q, v, a = sampled(unlimited)
    assert np.max(np.abs(torques_of(pendulum, q, v, a))) > 1.05 * 13.0


def test_a_weight_too_heavy_to_hold_is_out_of_reach(pendulum):
    limits = limits_of(pendulum).scaled(torque=0.6)  # 7.8 of 9.81 N m
    failure = time_optimal_trajectory(
        pendulum, np.array([[0.0, 0.0], [-0.2, 0.0]]), limits
    )
    assert_fails(failure, Failure.OUT_OF_REACH, "torque")


def test_a_payload_slows_the_arm_and_can_be_too_heavy(pendulum, loaded_pendulum):
    waypoints = np.array([[0.0, 0.0], [-0.4, 0.0]])
    limits = limits_of(pendulum)
    bare = time_optimal_trajectory(pendulum, waypoints, limits)
    loaded = time_optimal_trajectory(loaded_pendulum, waypoints, limits)
    assert loaded.end_time() > bare.end_time() + 0.02
    # 12.26 N m to hold 2.5 kg, 9.81 N m to hold 2 kg.
    weak = limits.scaled(torque=12.0 / 13.0)
    for scene, fails in ((pendulum, False), (loaded_pendulum, True)):
        found = time_optimal_trajectory(scene, waypoints, weak)
        assert isinstance(found, PlanningFailure) == fails


@pytest.mark.parametrize("waypoints", [np.zeros(7), np.zeros((2, 6))])
def test_waypoints_of_another_shape_are_refused(iiwa, waypoints):
    with pytest.raises(ValueError, match="shape"):
        time_optimal_trajectory(iiwa, waypoints, limits_of(iiwa))
    with pytest.raises(ValueError, match="shape"):
        tip_limited_trajectory(iiwa, waypoints, limits_of(iiwa), THESIS)


@pytest.mark.parametrize("rounding", [0.0, np.array([0.1, -0.1])])
def test_a_rounding_that_is_not_positive_is_refused(iiwa, rounding):
    with pytest.raises(ValueError, match="positive"):
        time_optimal_trajectory(
            iiwa, np.zeros((2, 7)), limits_of(iiwa), rounding=rounding
        )


THESIS = TipLimits()
STRETCHING = np.array([0.0, 0.0, 0.0, -1.7, 0.0, 1.4, 0.0])  # from where lines begin


def tip_motion(scene, waypoints, tip=THESIS, limits=None, **point):
    """Return the motion within the limits of the tip; those of joints are checked."""
    limits = limits or limits_of(scene)
    trajectory = tip_limited_trajectory(scene, waypoints, limits, tip, **point)
    if not isinstance(trajectory, PlanningFailure):
        assert_at_rest(trajectory, waypoints)
        assert_joints_within(trajectory, limits)
    return trajectory


# What a cubic spline through waypoints h = 0.02 m apart adds to speed, acceleration and
# jerk along a line, as a share of the limits. Angles over distance are functions whose
# nth derivative is about 1 / L^n with L the distance to where the arm is stretched,
# here more than 0.13 m; the spline's nth differs by less than L h^(4 - n) / (2 L^4).
# That, times (0.1 m/s)^n, is 0.05 for the jerk and 0.01 and less for the others.
LEAST_REACH_LEFT = 0.13  # m
SPLINE = (0.01, 0.01, 0.05)
limit = st.floats(0.02, 2.0)


def line(scene, q, offset, turn=None):
    """Return a straight path of the hand from `q`, with a turn if it is given."""
    X_WG = scene.X_WG(q)
    R_WG = X_WG.rotation() if turn is None else turn @ X_WG.rotation()
    target = HandTarget(X_WG.translation() + offset, R_WG)
    return plan_cartesian_path(scene, q, target)


def reach_left(scene, q):
    """Return how far the wrist may move away until the arm is stretched [m]."""
    scene.X_WG(q)  # moves the model
    shoulder, wrist = (
        scene.plant.GetFrameByName(name).CalcPoseInWorld(scene.context).translation()
        for name in ("link_2", "link_6")
    )
    return 0.42 + 0.4 - np.linalg.norm(wrist - shoulder)


def duration(d, tip):
    """Return the duration of a double-S profile from rest to rest.

    See Biagiotti and Melchiorri (2008), chapter 3.4.
    """
    v, a, j = tip.velocity, tip.acceleration, tip.jerk
    ramp = 2.0 * np.sqrt(v / j) if v * j < a * a else a / j + v / a
    if d >= v * ramp:
        return d / v + ramp
    if d >= 2.0 * a**3 / j**2:
        return a / j + np.sqrt((a / j) ** 2 + 4.0 * d / a)
    return np.cbrt(32.0 * d / j)


def along_line(scene, q, direction, p_GT=(0.0, 0.0, 0.0)):
    """Return the tip's position along a direction, and its distance from it [m]."""
    p_WT = np.array([scene.X_WG(x) @ np.array(p_GT) for x in q])
    offsets = p_WT - p_WT[0]
    along = offsets @ direction
    return along, np.linalg.norm(offsets - along[:, None] * direction, axis=1)


def assert_at_rest(trajectory, waypoints):
    """Assert that a motion goes from the first waypoint to the last, at rest there."""
    end = trajectory.end_time()
    assert trajectory.start_time() == 0.0
    np.testing.assert_allclose(trajectory.value(0.0)[:, 0], waypoints[0], atol=1e-9)
    np.testing.assert_allclose(trajectory.value(end)[:, 0], waypoints[-1], atol=1e-9)
    for time in (0.0, end):
        for order in (1, 2):
            derivative = trajectory.EvalDerivative(time, order)
            np.testing.assert_allclose(derivative, 0.0, atol=1e-9)


def assert_joints_within(trajectory, limits):
    _, _, v, a = sampled(trajectory)
    assert np.all(np.abs(v) <= limits.velocity)
    assert np.all(np.abs(a) <= limits.acceleration)


@pytest.mark.slow
@settings(max_examples=25)
@given(st.tuples(unit, unit, unit), st.floats(0.04, 0.25))
def test_the_tip_keeps_its_limits_on_a_straight_line(iiwa, direction, length):
    assume(np.linalg.norm(direction) > 0.1)
    direction = np.array(direction) / np.linalg.norm(direction)
    waypoints = line(iiwa, STRETCHING, length * direction)
    assume(not isinstance(waypoints, PlanningFailure))
    assume(min(reach_left(iiwa, q) for q in waypoints) > LEAST_REACH_LEFT)
    trajectory = tip_motion(iiwa, waypoints)
    assert trajectory.end_time() == pytest.approx(duration(length, THESIS), rel=1e-4)
    times = np.linspace(0.0, trajectory.end_time(), 1001)
    q = trajectory.vector_values(times).T
    along, off = along_line(iiwa, q, direction)
    # Joint lines of 0.02 m leave the hand's line by 0.1 mm, the spline by less.
    assert np.max(off) < 1e-4
    motion = along
    bounds = (THESIS.velocity, THESIS.acceleration, THESIS.jerk)
    for bound, spline in zip(bounds, SPLINE, strict=True):
        motion = np.diff(motion) / times[1]
        assert np.max(np.abs(motion)) <= bound * (1.0 + spline)


def test_the_tip_moves_as_fast_as_it_may(iiwa, home):
    trajectory = tip_motion(iiwa, line(iiwa, home, np.array([0.1, 0.2, 0.2])))
    assert trajectory.end_time() == pytest.approx(0.3 / 0.1 + 2.0, rel=1e-4)
    times = np.linspace(0.0, trajectory.end_time(), 501)
    direction = np.array([1.0, 2.0, 2.0]) / 3.0
    along, _ = along_line(iiwa, trajectory.vector_values(times).T, direction)
    # The jerk is positive for a second, then negative for a second.
    assert np.interp(1.0, times, along) == pytest.approx(0.1 / 6.0, rel=1e-3)
    assert np.interp(2.0, times, along) == pytest.approx(0.1, rel=1e-3)
    assert np.interp(2.5, times, along) == pytest.approx(0.15, rel=1e-3)


@settings(max_examples=25)
@given(limit, limit, limit, st.floats(0.02, 0.3))
def test_a_motion_takes_the_time_of_its_seven_phases(
    pendulum, velocity, acceleration, jerk, d
):
    tip = TipLimits(
        velocity=velocity, acceleration=acceleration, jerk=jerk, angle_weight=0.0
    )
    # The shoulder moves the hand on a circle of 0.5 m.
    waypoints = np.array([[0.0, 0.0], [-d / 0.5, 0.0]])
    fast = MotionLimits(*(np.full(2, 1e6) for _ in range(3)))
    trajectory = tip_limited_trajectory(pendulum, waypoints, fast, tip)
    # Chords of at most 0.03 m are shorter than their arcs by (0.03 / 0.5)² / 24.
    assert trajectory.end_time() == pytest.approx(duration(d, tip), rel=2e-4)


def test_a_turn_counts_by_its_weight(iiwa, home):
    turn = RotationMatrix.MakeZRotation(0.8)
    waypoints = line(iiwa, home, np.zeros(3), turn)
    for weight in (0.1, 0.3):
        tip = TipLimits(angle_weight=weight)
        trajectory = tip_motion(iiwa, waypoints, tip)
        expected = duration(0.8 * weight, tip)
        assert trajectory.end_time() == pytest.approx(expected, rel=1e-4)


def test_the_tip_may_be_in_front_of_the_hand(iiwa, home):
    X_WG, p_GT = iiwa.X_WG(home), np.array([0.1, 0.0, 0.02])
    offset = np.array([0.1, -0.1, 0.1])
    target = HandTarget(X_WG @ p_GT + offset, X_WG.rotation(), p_GT=p_GT)
    waypoints = plan_cartesian_path(iiwa, home, target)
    trajectory = tip_motion(iiwa, waypoints, p_GT=p_GT)
    length = np.linalg.norm(offset)
    assert trajectory.end_time() == pytest.approx(duration(length, THESIS), rel=1e-4)
    _, q, _, _ = sampled(trajectory, 100)
    along, off = along_line(iiwa, q, offset / length, p_GT)
    assert along[-1] == pytest.approx(length, abs=1e-5)
    assert np.max(off) < 1e-4


@pytest.mark.slow
@settings(max_examples=15)
@given(st.tuples(unit, unit, unit), st.floats(0.05, 1.0))
def test_joints_keep_their_limits_however_fast_the_tip_may_be(iiwa, direction, share):
    assume(np.linalg.norm(direction) > 0.1)
    offset = 0.3 * np.array(direction) / np.linalg.norm(direction)
    waypoints = line(iiwa, STRETCHING, offset)
    assume(not isinstance(waypoints, PlanningFailure))
    limits = limits_of(iiwa).scaled(share, share)
    fast = TipLimits(velocity=10.0, acceleration=100.0, jerk=2000.0)
    trajectory = tip_motion(iiwa, waypoints, fast, limits)
    # It is no slower than it must be: some joint is near a limit somewhere.
    _, _, v, a = sampled(trajectory)
    assert limits.slowdown(v, a) > 0.97


def test_a_path_around_something_goes_through_its_waypoints(iiwa, home):
    corner = home + np.array([0.4, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
    end = home + np.array([0.8, 0.0, 0.0, 0.2, 0.0, 0.0, 1.0])
    trajectory = tip_motion(iiwa, np.array([home, corner, end]))
    _, q, _, _ = sampled(trajectory, 2000)
    assert np.min(np.linalg.norm(q - corner, axis=1)) < 2e-3
    # Elsewhere it stays near the lines between them.
    path = np.concatenate(
        [np.linspace(a, b, 500) for a, b in [(home, corner), (corner, end)]]
    )
    off = [np.min(np.linalg.norm(path - x, axis=1)) for x in q[::20]]
    assert np.max(off) < 0.02


def test_a_joint_line_between_far_postures_is_followed(iiwa, home):
    way = np.array([1.5, 0.2, 0.0, 0.3, 0.0, 0.0, 0.0])
    trajectory = tip_motion(iiwa, plan_joint_path(iiwa, home, home + way))
    _, q, _, _ = sampled(trajectory, 400)
    share = (q - home) @ way / (way @ way)
    np.testing.assert_allclose(q, home + share[:, None] * way, atol=1e-9)
    p_WT = np.array([iiwa.X_WG(x).translation() for x in q])
    speed = np.linalg.norm(np.diff(p_WT, axis=0), axis=1) * 399 / trajectory.end_time()
    assert np.max(speed) <= THESIS.velocity * (1.0 + SPLINE[0])
    assert np.max(speed) > 0.8 * THESIS.velocity  # the hand's turn counts, too


def test_a_turn_about_the_tip_takes_the_time_that_the_joints_need(iiwa, home):
    tip = TipLimits(angle_weight=0.0, velocity=10.0, acceleration=100.0, jerk=2000.0)
    tip_motion(iiwa, np.array([home, home + np.eye(7)[6]]), tip)


@pytest.mark.parametrize("count", [1, 3])
def test_standing_still_takes_next_to_no_time(iiwa, home, count):
    trajectory = tip_motion(iiwa, np.tile(home, (count, 1)))
    assert 0.0 < trajectory.end_time() < 0.05


@settings(max_examples=20)
@given(st.floats(-9.0, -1.0))
def test_tiny_moves_reach_their_end(iiwa, exponent):
    home = np.array([0.0, -0.1, 0.0, -1.9, 0.0, 1.3, 0.0])
    waypoints = np.array([home, home + 10.0**exponent])
    trajectory = tip_limited_trajectory(iiwa, waypoints, limits_of(iiwa), THESIS)
    np.testing.assert_allclose(
        trajectory.value(trajectory.end_time())[:, 0], waypoints[-1], atol=1e-9
    )


def test_the_obstacle_in_the_way_is_named(iiwa, home):
    waypoints = line(iiwa, home, np.array([0.0, 0.3, 0.0]))
    middle = iiwa.X_WG(waypoints[len(waypoints) // 2]).translation()
    with iiwa.standing(Sphere(0.02), RigidTransform(middle)):
        failure = tip_motion(iiwa, waypoints)
    assert_fails(failure, Failure.BLOCKED, "obstacle")
