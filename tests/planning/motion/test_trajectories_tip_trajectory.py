import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.common.exceptions import ScenarioError
from drake_srg.planning.motion.inverse_kinematics import HandTarget
from drake_srg.planning.motion.limits import MotionLimits, TipLimits
from drake_srg.planning.motion.paths import plan_cartesian_path, plan_joint_path
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.planning.motion.trajectories import tip_limited_trajectory
from drake_srg.scenario.typed_yaml import load_typed
from drake_srg.types import Sphere

THESIS = TipLimits()
# What a cubic spline through waypoints h = 0.02 m apart adds to speed, acceleration and
# jerk along a line, as a share of the limits. Angles over distance are functions whose
# nth derivative is about 1 / L^n with L the distance to where the arm is stretched,
# here more than 0.13 m; the spline's nth differs by less than L h^(4 - n) / (2 L^4).
# That, times (0.1 m/s)^n, is 0.05 for the jerk and 0.01 and less for the others.
LEAST_REACH_LEFT = 0.13  # m
SPLINE = (0.01, 0.01, 0.05)
unit = st.floats(-1.0, 1.0)
limit = st.floats(0.02, 2.0)


def limits_of(scene):
    return MotionLimits.of_plant(scene)


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


def sampled(trajectory, count=1000):
    """Return times, and q, v and a at these, each of shape (count, N)."""
    times = np.linspace(0.0, trajectory.end_time(), count)
    derivatives = [
        np.array([trajectory.EvalDerivative(t, order)[:, 0] for t in times])
        for order in range(3)
    ]
    return times, *derivatives


def along_line(scene, q, direction, p_GT=(0.0, 0.0, 0.0)):
    """Return the tip's position along a direction, and its distance from it [m]."""
    p_WT = np.array([scene.X_WG(x) @ np.array(p_GT) for x in q])
    offsets = p_WT - p_WT[0]
    along = offsets @ direction
    return along, np.linalg.norm(offsets - along[:, None] * direction, axis=1)


def assert_at_rest(trajectory, waypoints):
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
    home = np.array([0.0, 0.0, 0.0, -1.7, 0.0, 1.4, 0.0])
    waypoints = line(iiwa, home, length * direction)
    assume(not isinstance(waypoints, PlanningFailure))
    assume(min(reach_left(iiwa, q) for q in waypoints) > LEAST_REACH_LEFT)
    trajectory = tip_limited_trajectory(iiwa, waypoints, limits_of(iiwa), THESIS)
    assert_at_rest(trajectory, waypoints)
    assert_joints_within(trajectory, limits_of(iiwa))
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
    waypoints = line(iiwa, home, np.array([0.1, 0.2, 0.2]))
    trajectory = tip_limited_trajectory(iiwa, waypoints, limits_of(iiwa), THESIS)
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
        trajectory = tip_limited_trajectory(iiwa, waypoints, limits_of(iiwa), tip)
        expected = duration(0.8 * weight, tip)
        assert trajectory.end_time() == pytest.approx(expected, rel=1e-4)


def test_the_tip_may_be_in_front_of_the_hand(iiwa, home):
    X_WG, p_GT = iiwa.X_WG(home), np.array([0.1, 0.0, 0.02])
    offset = np.array([0.1, -0.1, 0.1])
    target = HandTarget(X_WG @ p_GT + offset, X_WG.rotation(), p_GT=p_GT)
    waypoints = plan_cartesian_path(iiwa, home, target)
    trajectory = tip_limited_trajectory(
        iiwa, waypoints, limits_of(iiwa), THESIS, p_GT=p_GT
    )
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
    home = np.array([0.0, 0.0, 0.0, -1.7, 0.0, 1.4, 0.0])
    waypoints = line(iiwa, home, offset)
    assume(not isinstance(waypoints, PlanningFailure))
    limits = limits_of(iiwa).scaled(share, share)
    fast = TipLimits(velocity=10.0, acceleration=100.0, jerk=2000.0)
    trajectory = tip_limited_trajectory(iiwa, waypoints, limits, fast)
    assert_at_rest(trajectory, waypoints)
    assert_joints_within(trajectory, limits)
    # It is no slower than it must be: some joint is near a limit somewhere.
    _, _, v, a = sampled(trajectory)
    use = max(
        np.max(np.abs(v) / limits.velocity),
        np.sqrt(np.max(np.abs(a) / limits.acceleration)),
    )
    assert use > 0.97


def test_a_path_around_something_goes_through_its_waypoints(iiwa, home):
    corner = home + np.array([0.4, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
    end = home + np.array([0.8, 0.0, 0.0, 0.2, 0.0, 0.0, 1.0])
    waypoints = np.array([home, corner, end])
    trajectory = tip_limited_trajectory(iiwa, waypoints, limits_of(iiwa), THESIS)
    assert_at_rest(trajectory, waypoints)
    assert_joints_within(trajectory, limits_of(iiwa))
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
    waypoints = plan_joint_path(iiwa, home, home + way)
    trajectory = tip_limited_trajectory(iiwa, waypoints, limits_of(iiwa), THESIS)
    _, q, _, _ = sampled(trajectory, 400)
    share = (q - home) @ way / (way @ way)
    np.testing.assert_allclose(q, home + share[:, None] * way, atol=1e-9)
    p_WT = np.array([iiwa.X_WG(x).translation() for x in q])
    speed = np.linalg.norm(np.diff(p_WT, axis=0), axis=1) * 399 / trajectory.end_time()
    assert np.max(speed) <= THESIS.velocity * (1.0 + SPLINE[0])
    assert np.max(speed) > 0.8 * THESIS.velocity  # the hand's turn counts, too


def test_a_turn_about_the_tip_takes_the_time_that_the_joints_need(iiwa, home):
    waypoints = np.array([home, home + np.eye(7)[6]])
    tip = TipLimits(angle_weight=0.0, velocity=10.0, acceleration=100.0, jerk=2000.0)
    trajectory = tip_limited_trajectory(iiwa, waypoints, limits_of(iiwa), tip)
    assert_at_rest(trajectory, waypoints)
    assert_joints_within(trajectory, limits_of(iiwa))


@pytest.mark.parametrize("count", [1, 3])
def test_standing_still_takes_next_to_no_time(iiwa, home, count):
    trajectory = tip_limited_trajectory(
        iiwa, np.tile(home, (count, 1)), limits_of(iiwa), THESIS
    )
    assert_at_rest(trajectory, [home])
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


def test_the_same_path_gives_the_same_motion(iiwa, home):
    waypoints = line(iiwa, home, np.array([0.1, 0.0, 0.1]))
    first, second = (
        tip_limited_trajectory(iiwa, waypoints, limits_of(iiwa), THESIS)
        for _ in range(2)
    )
    times = np.linspace(0.0, first.end_time(), 50)
    np.testing.assert_array_equal(
        first.vector_values(times), second.vector_values(times)
    )


def test_the_obstacle_in_the_way_is_named(iiwa, home):
    waypoints = line(iiwa, home, np.array([0.0, 0.3, 0.0]))
    middle = iiwa.X_WG(waypoints[len(waypoints) // 2]).translation()
    with iiwa.standing(Sphere(0.02), RigidTransform(middle)):
        failure = tip_limited_trajectory(iiwa, waypoints, limits_of(iiwa), THESIS)
    assert isinstance(failure, PlanningFailure)
    assert "obstacle" in failure.message
    assert failure.clearance is not None


@pytest.mark.parametrize("waypoints", [np.zeros(7), np.zeros((2, 6))])
def test_invalid_arguments_are_refused(iiwa, waypoints):
    with pytest.raises(ValueError, match="shape"):
        tip_limited_trajectory(iiwa, waypoints, limits_of(iiwa), THESIS)


def test_limits_are_loaded_from_yaml():
    tip = load_typed(TipLimits, {"velocity": 0.2, "jerk": 1}, "file")
    assert tip == TipLimits(velocity=0.2, jerk=1.0)
    with pytest.raises(ScenarioError, match=r"file: jerk: must be greater than 0\.0"):
        load_typed(TipLimits, {"jerk": 0}, "file")
