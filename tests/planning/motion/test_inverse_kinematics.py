from __future__ import annotations

import functools
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_srg.planning.motion.inverse_kinematics import (
    AxisTarget,
    HandTarget,
    IkFailure,
    IkSolution,
    Requirement,
    find_posture,
    solve_inverse_kinematics,
)
from drake_srg.scenario import load_scenario
from drake_srg.station.planners import own_scene
from drake_srg.types import Failure, Sphere

Z = np.array([0.0, 0.0, 1.0])
angles = st.floats(0.0, 3.0)
unit = st.floats(-1.0, 1.0)
vectors = st.tuples(unit, unit, unit).map(np.array)
poses = st.builds(
    lambda rpy, p: RigidTransform(RollPitchYaw(*rpy), p), vectors, vectors
)


@given(poses)
def test_a_pose_meets_its_own_target(X_WG):
    target = HandTarget.from_pose(X_WG)
    assert target.distance(X_WG) == 0.0
    assert target.angle_violation(X_WG) == 0.0


@given(poses, vectors, vectors)
def test_a_shifted_target_is_as_far_away_as_it_was_shifted(X_WG, p_GT, shift):
    target = HandTarget(X_WG @ p_GT, p_GT=p_GT).shifted(shift)
    assert target.distance(X_WG) == pytest.approx(np.linalg.norm(shift), abs=1e-12)


@given(angles)
def test_an_orientation_is_violated_beyond_its_tolerance(angle):
    target = HandTarget(np.zeros(3), RotationMatrix(), angle_tolerance=0.1)
    X_WG = RigidTransform(RotationMatrix.MakeXRotation(angle), np.zeros(3))
    expected = max(0.0, angle - 0.1)
    assert target.angle_violation(X_WG) == pytest.approx(expected, abs=1e-9)


@given(angles, st.floats(-3.0, 3.0))
def test_an_axis_is_violated_beyond_its_angle_whatever_the_turn_about_it(lean, turn):
    target = HandTarget(np.zeros(3), axes=(AxisTarget(Z, Z, 0.2),))
    R_WG = RotationMatrix.MakeXRotation(lean) @ RotationMatrix.MakeZRotation(turn)
    X_WG = RigidTransform(R_WG, np.zeros(3))
    expected = max(0.0, lean - 0.2)
    assert target.angle_violation(X_WG) == pytest.approx(expected, abs=1e-9)


def test_the_worst_of_several_axes_counts():
    axes = (AxisTarget(Z, Z, 0.2), AxisTarget(Z, np.array([1.0, 0.0, 0.0]), 0.5))
    target = HandTarget(np.zeros(3), axes=axes)
    assert target.angle_violation(RigidTransform()) == pytest.approx(np.pi / 2 - 0.5)


def test_a_point_alone_leaves_the_orientation_free():
    X_WG = RigidTransform(RotationMatrix.MakeYRotation(2.0), [1.0, 2.0, 3.0])
    assert HandTarget(X_WG.translation()).angle_violation(X_WG) == 0.0


DOWN = AxisTarget(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0]), 0.05)
# SNOPT meets constraints to 1e-6; for the cosine of an angle near 0 that is 1e-3 rad.
ANGLE_SLACK = 1e-3


def from_above(x: float, y: float, z: float, yaw: float) -> RigidTransform:
    """Return a pose with the palm's x down, and its y turned by `yaw`."""
    side = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    down = np.array([0.0, 0.0, -1.0])
    R_WG = RotationMatrix(np.column_stack([down, side, np.cross(down, side)]))
    return RigidTransform(R_WG, [x, y, z])


@pytest.fixture
def solve(iiwa, home):
    """Solve for the iiwa, near home."""
    return functools.partial(solve_inverse_kinematics, iiwa, q_nominal=home)


@settings(max_examples=40, deadline=None)
@given(unit, unit, unit)
def test_every_can_is_reached_from_above_freely_and_within_limits(iiwa, x, y, yaw):
    X_WG = from_above(0.6 + 0.15 * x, 0.2 * y, 0.227, np.pi * yaw)
    home = np.array([0.0, -0.1, 0.0, -1.9, 0.0, 1.3, 0.0])
    found = solve_inverse_kinematics(iiwa, HandTarget.from_pose(X_WG), q_nominal=home)
    assert isinstance(found, IkSolution)
    target = HandTarget.from_pose(X_WG)
    # The tolerance is a box; its corner is sqrt(3) away.
    assert target.distance(iiwa.X_WG(found.q)) <= 2e-4
    assert target.angle_violation(iiwa.X_WG(found.q)) <= ANGLE_SLACK
    assert iiwa.is_free(found.q)
    assert np.all((found.q > iiwa.lower + 0.0199) & (found.q < iiwa.upper - 0.0199))
    assert found.cost == pytest.approx(np.sum((found.q - home) ** 2))


def test_the_same_call_returns_the_same_solution(solve):
    first, second = (solve(REACHED) for _ in range(2))
    np.testing.assert_array_equal(first.q, second.q)


def test_the_nominal_posture_reaches_its_own_pose_at_no_cost(iiwa, home, solve):
    assert solve(HandTarget.from_pose(iiwa.X_WG(home))).cost < 1e-5


def test_an_axis_target_leaves_the_turn_about_the_axis_free(iiwa, home, solve):
    tip = np.array([0.16, 0.0, 0.0])
    target = HandTarget(np.array([0.6, 0.1, 0.1]), axes=(DOWN,), p_GT=tip)
    found = solve(target)
    X_WG = iiwa.X_WG(found.q)
    np.testing.assert_allclose(X_WG @ tip, target.p_WT, atol=1.1e-4)
    assert target.angle_violation(X_WG) <= ANGLE_SLACK
    turned = solve(target, q_nominal=home + np.eye(7)[6])
    assert abs(turned.q[6] - found.q[6]) > 0.5


@pytest.mark.parametrize(
    ("target", "requirement", "least", "most"),
    [
        # 1.28 m from the shoulder; the stretched arm has 0.946 m.
        (HandTarget(np.array([1.28, 0.0, 0.36])), Requirement.POSITION, 0.3, 0.37),
        (
            HandTarget.from_pose(from_above(0.9, 0.0, 0.2, 0.0)),
            Requirement.ORIENTATION, 0.1, 1.5,
        ),
        (
            HandTarget(np.array([0.85, 0.0, 0.36]), axes=(
                AxisTarget(np.array([1.0, 0, 0]), np.array([-1.0, 0, 0]), 0.1),)),
            Requirement.AXIS, 0.5, np.pi,
        ),
        (
            HandTarget.from_pose(from_above(0.15, 0.0, 0.2, 0.0)),
            Requirement.JOINT_LIMITS, 0.1, 2.0,
        ),
        # The open fingers are 0.1 m in front of the palm.
        (
            HandTarget.from_pose(from_above(0.6, 0.0, 0.05, 0.0)),
            Requirement.MINIMUM_DISTANCE, 0.01, 0.1,
        ),
    ],
)  # fmt: skip
def test_a_failure_names_what_cannot_be_met(solve, target, requirement, least, most):
    failure = solve(target)
    assert isinstance(failure, IkFailure)
    assert failure.requirement is requirement
    assert least < failure.violation < most
    assert requirement.value in failure.message
    blocked = requirement is Requirement.MINIMUM_DISTANCE
    assert failure.failure is (Failure.BLOCKED if blocked else Failure.OUT_OF_REACH)


def test_the_blocking_body_is_named(iiwa, solve):
    X_WG = from_above(0.6, 0.0, 0.3, 0.0)
    with iiwa.standing(Sphere(0.05), X_WG):
        failure = solve(HandTarget.from_pose(X_WG))
        unchecked = solve(HandTarget.from_pose(X_WG), check_clearance=False)
    assert isinstance(failure, IkFailure)
    assert "obstacle" in failure.message
    assert isinstance(unchecked, IkSolution)


def test_two_joints_reach_targets_in_their_plane_only(pendulum):
    nominal = np.array([0.5, 0.5])
    p_WT = np.array([0.25, 0.0, -0.25])  # the elbow bends by a right angle
    found = solve_inverse_kinematics(pendulum, HandTarget(p_WT), q_nominal=nominal)
    assert abs(found.q[1]) == pytest.approx(np.pi / 2, abs=2e-3)
    aside = HandTarget(p_WT + np.array([0.0, 0.1, 0.0]))
    failure = solve_inverse_kinematics(pendulum, aside, q_nominal=nominal)
    assert failure.requirement is Requirement.POSITION
    assert failure.violation == pytest.approx(0.1, abs=1e-3)


def test_a_limit_is_told_in_the_unit_of_its_joint():
    scenario = load_scenario("gripper_bench")
    scene, home = own_scene(scenario), np.array(scenario.arm.home)
    far = scene.X_WG(home).translation() + 3.0 * Z
    failure = solve_inverse_kinematics(scene, HandTarget(far), q_nominal=home)
    assert failure.requirement is Requirement.JOINT_LIMITS
    assert re.search(r"would have to go \d\.\d{3} m beyond its limit", failure.message)


def test_a_vector_of_the_wrong_size_is_refused_with_the_joint_names(solve):
    with pytest.raises(ValueError, match=r"q_nominal needs one entry.*joint_1"):
        solve(HandTarget(np.zeros(3)), q_nominal=np.zeros(6))


def named(constraint, name):
    constraint.evaluator().set_description(name)


def elbow_of(scene, ik, lower, upper):
    """Keep the elbow's height between two bounds [m]."""
    arm = scene.plant.GetModelInstanceByName("arm")
    elbow = scene.plant.GetFrameByName("link_4", arm)
    bounds = ([-9.0, -9.0, lower], [9.0, 9.0, upper])
    world = scene.plant.world_frame()
    named(ik.AddPositionConstraint(elbow, np.zeros(3), world, *bounds), "elbow height")


def elbow_height(scene, q):
    context = scene.plant.CreateDefaultContext()
    scene.plant.SetPositions(context, scene.positions(q))
    arm = scene.plant.GetModelInstanceByName("arm")
    frame = scene.plant.GetFrameByName("link_4", arm)
    return frame.CalcPoseInWorld(context).translation()[2]


REACHED = HandTarget.from_pose(from_above(0.55, 0.1, 0.2, 2.5))


def test_a_constraint_of_ones_own_is_met_with_all_others(iiwa, solve):
    below = elbow_height(iiwa, solve(REACHED).q) - 0.05

    def low_elbow(ik):
        elbow_of(iiwa, ik, -9.0, below)

    found = solve(REACHED, check_clearance=False, extend=low_elbow)
    assert isinstance(found, IkSolution)
    assert elbow_height(iiwa, found.q) <= below + 1e-5
    assert REACHED.distance(iiwa.X_WG(found.q)) <= 2e-4


def test_a_cost_of_ones_own_is_part_of_the_cost(iiwa, home, solve):
    def third_joint_turned(ik):
        q = ik.q()[iiwa.arm_indices]
        ik.get_mutable_prog().AddQuadraticCost(100.0 * (q[2] - 0.4) ** 2)

    found = solve(REACHED, extend=third_joint_turned)
    assert abs(found.q[2] - 0.4) < 0.05
    own = 100.0 * (found.q[2] - 0.4) ** 2
    assert found.cost == pytest.approx(np.sum((found.q - home) ** 2) + own, rel=1e-6)


def test_variables_of_ones_own_are_solved_for(iiwa, solve):
    def share(ik):
        prog, q = ik.get_mutable_prog(), ik.q()[iiwa.arm_indices]
        (s,) = prog.NewContinuousVariables(1, "share")
        prog.AddBoundingBoxConstraint(0.2, 0.3, s)
        prog.AddLinearConstraint(q[2] == s)

    found = solve(REACHED, extend=share)
    assert 0.2 - 1e-6 <= found.q[2] <= 0.3 + 1e-6


def test_an_impossible_constraint_is_named_as_ones_own(iiwa, solve):
    def impossible(ik):
        prog, q = ik.get_mutable_prog(), ik.q()[iiwa.arm_indices]
        named(prog.AddBoundingBoxConstraint(-1.0, 1.0, q[0]), "first joint")
        elbow_of(iiwa, ik, 5.0, 9.0)

    target = HandTarget(np.array([0.6, 0.1, 0.1]), axes=(DOWN,))
    failure = solve(target, max_starts=3, extend=impossible)
    assert isinstance(failure, IkFailure)
    assert failure.requirement is Requirement.OWN
    assert failure.failure is Failure.OUT_OF_REACH
    assert failure.message.startswith("elbow height (your own): cannot be met")
    assert failure.violation > 3.0


def test_constraints_that_exclude_each_other_are_named_together(iiwa, solve):
    def contradiction(ik):
        prog, q = ik.get_mutable_prog(), ik.q()[iiwa.arm_indices]
        for low, high in ((5.0, 6.0), (7.0, 8.0)):
            prog.AddLinearConstraint([1.0], low, high, q[:1])

    failure = solve(REACHED, max_starts=2, extend=contradiction)
    assert failure.requirement is Requirement.OWN
    assert failure.message.startswith("constraint 1, constraint 2 (your own)")


def test_a_target_out_of_reach_is_not_blamed_on_ones_own(iiwa, solve):
    def any_elbow(ik):
        elbow_of(iiwa, ik, -9.0, 9.0)

    far = HandTarget(np.array([3.0, 0.0, 0.5]))
    failure = solve(far, max_starts=2, extend=any_elbow)
    assert failure.requirement is Requirement.POSITION


@pytest.mark.parametrize("x", [0.45, 0.6, 0.75, 1.2])
def test_a_posture_is_the_solution_or_none(iiwa, home, solve, x):
    target = HandTarget(np.array([x, 0.1, 0.3]), axes=(DOWN,))
    solution = solve(target, max_starts=3)
    found = find_posture(iiwa, target, q_nominal=home, max_starts=3)
    assert (found is None) == isinstance(solution, IkFailure)
    if found is not None:
        np.testing.assert_array_equal(found.q, solution.q)
