from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.planning import RobotDiagramBuilder
from pydrake.trajectories import PiecewisePolynomial

from drake_srg import parsing
from drake_srg.planning.motion.inverse_kinematics import (
    HandTarget,
    IkSolution,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.limits import MotionLimits
from drake_srg.planning.motion.planning_scene import (
    Clearance,
    PlanningScene,
    carried_drift,
)
from drake_srg.types import Box, Cylinder, Sphere

CAN = Cylinder(0.033, 0.102)
# A grasp from above: the can's axis along the hand's x, its centre ahead of the palm.
X_GO_ABOVE = RigidTransform(RotationMatrix.MakeYRotation(-np.pi / 2), [0.176, 0.0, 0.0])


def posture_above(scene, home, can_bottom):
    """Return a posture with a can held as in X_GO_ABOVE, its bottom at a height."""
    X_WO = RigidTransform([0.55, 0.0, can_bottom + 0.051])
    X_WG = X_WO @ X_GO_ABOVE.inverse()
    found = solve_inverse_kinematics(
        scene, HandTarget.from_pose(X_WG), q_nominal=home, check_clearance=False
    )
    assert isinstance(found, IkSolution)
    return found.q


def test_home_is_free_and_an_arm_in_the_table_is_not(iiwa, home):
    assert iiwa.is_free(home)
    fallen = np.array([0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert not iiwa.is_free(fallen)
    clearance = iiwa.clearance(fallen)
    assert clearance.spare < 0.0
    assert "table" in clearance.bodies
    assert "table" in str(clearance)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-1, 1), min_size=7, max_size=7))
def test_is_free_and_clearance_agree(iiwa, unit):
    q = (iiwa.upper + iiwa.lower + np.array(unit) * (iiwa.upper - iiwa.lower)) / 2
    assert iiwa.is_free(q) == (iiwa.clearance(q).spare > 0.0)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-1, 1), min_size=14, max_size=14))
def test_no_body_moves_further_than_a_step_along_an_edge(iiwa, unit):
    q1, q2 = np.array(unit).reshape(2, 7) * iiwa.upper
    samples = iiwa.samples(np.array([q1, q2]))
    np.testing.assert_array_equal(samples[0], q1)
    np.testing.assert_allclose(samples[-1], q2, atol=1e-12)
    middle = len(samples) // 2
    for point in ([0.0, 0.0, 0.0], [0.17, 0.0, 0.0], [0.07, 0.14, 0.0]):
        moved = (
            iiwa.X_WG(samples[middle]) @ point - iiwa.X_WG(samples[middle - 1]) @ point
        )
        assert np.linalg.norm(moved) <= iiwa.step


@pytest.mark.parametrize("shape", [CAN, Box((0.1, 0.1, 0.1)), Sphere(0.05)])
def test_an_obstacle_blocks_and_leaves_with_its_context(iiwa, home, shape):
    X_WO = iiwa.X_WG(home) @ RigidTransform([0.1, 0.0, 0.0])
    with iiwa.standing(shape, X_WO):
        assert not iiwa.is_free(home)
        assert "obstacle" in iiwa.clearance(home).bodies
    assert iiwa.is_free(home)


def test_a_touchable_object_blocks_the_arm_but_not_the_gripper(iiwa, home):
    at_hand = iiwa.X_WG(home) @ RigidTransform([0.12, 0.0, 0.0])
    at_forearm = RigidTransform([0.2, 0.0, 0.85])
    with iiwa.standing(CAN, at_hand, touchable=True):
        assert iiwa.is_free(home)
    with iiwa.standing(Sphere(0.1), at_forearm, touchable=True):
        assert not iiwa.is_free(home)
        assert "standing_object" in iiwa.clearance(home).bodies


def test_contexts_nest_and_survive_exceptions(iiwa, home):
    X_WO = iiwa.X_WG(home) @ RigidTransform([0.1, 0.0, 0.0])
    with (
        pytest.raises(KeyError),
        iiwa.standing(CAN, RigidTransform([5.0, 0.0, 0.0])),
        iiwa.standing(CAN, X_WO),
    ):
        assert not iiwa.is_free(home)
        raise KeyError
    assert iiwa.is_free(home)


def test_a_held_can_may_stand_on_the_table_only_with_a_negative_margin(iiwa, home):
    standing = posture_above(iiwa, home, can_bottom=0.0)
    with iiwa.holding(CAN, X_GO_ABOVE, margin=-0.003):
        assert iiwa.is_free(standing)
        assert not iiwa.is_free(posture_above(iiwa, home, can_bottom=-0.005))
    with iiwa.holding(CAN, X_GO_ABOVE):
        assert not iiwa.is_free(standing)
        assert set(iiwa.clearance(standing).bodies) == {"held_object", "table"}
        assert iiwa.is_free(posture_above(iiwa, home, can_bottom=0.006))
        assert not iiwa.is_free(posture_above(iiwa, home, can_bottom=0.004))


def test_a_held_object_must_not_hit_the_arm(iiwa, home):
    assert iiwa.is_free(home)
    with iiwa.holding(Sphere(0.05), RigidTransform([-0.126, 0.0, 0.0])):
        assert "held_object" in iiwa.clearance(home).bodies
        assert not iiwa.is_free(home)


def test_fingers_stay_where_they_are_set(iiwa, home):
    reaching = posture_above(iiwa, home, can_bottom=-0.06)
    try:
        iiwa.fingers = np.full(4, 0.0)
        with_open = iiwa.is_free(reaching)
        straight = np.array([1.57 * ("base" in name) for name in iiwa.finger_names])
        iiwa.fingers = straight
        with_straight = iiwa.is_free(reaching)
        np.testing.assert_array_equal(iiwa.fingers, straight)
    finally:
        iiwa.fingers = np.zeros(4)
    assert with_open
    assert not with_straight  # straight fingers reach 0.06 m further than open ones


@pytest.mark.parametrize("margin", [-0.01, 0.0])
def test_invalid_margins_are_refused_before_anything_is_built(margin):
    with pytest.raises(ValueError, match="must be positive"):
        PlanningScene(RobotDiagramBuilder(), margin=margin)


def test_a_copy_has_a_state_of_its_own(iiwa, home):
    twin, before = iiwa.copy(), iiwa.fingers
    assert twin.clearance(home) == iiwa.clearance(home)
    twin.fingers = before + 0.1
    np.testing.assert_array_equal(iiwa.fingers, before)
    twin.fingers = before
    with twin.standing(Sphere(0.05), iiwa.X_WG(home)):
        assert not twin.is_free(home)
        assert iiwa.is_free(home)
    assert twin.is_free(home)


TIME, HALF_STEP = 2.0, 0.006


def turn(*joints):
    """Return a motion at constant speed, by an angle per joint in `TIME`."""
    ends = np.column_stack([np.zeros(len(joints)), joints])
    return PiecewisePolynomial.FirstOrderHold([0.0, TIME], ends)


@pytest.mark.parametrize("p_GO", [[0.0, 0.0, 0.0], [0.3, 0.0, 0.0]])
def test_what_turns_about_one_joint_drifts_outwards(pendulum, p_GO):
    motion = turn(1.2, 0.0)
    drift = carried_drift(pendulum, motion, np.array(p_GO), HALF_STEP)
    radius, speed = 0.5 + p_GO[0], 1.2 / TIME
    outwards = speed**2 * radius * HALF_STEP * TIME
    np.testing.assert_allclose(drift, [outwards, 0.0, 0.0], atol=1e-6)


def test_it_is_what_steps_add_up_to(pendulum):
    motion, h, p_GO = turn(0.8, -1.3), 1e-3, np.array([0.1, 0.0, 0.05])
    X_GO = p_GO.copy()
    for t in np.arange(0.0, TIME, h):
        q, v = motion.value(t).ravel(), motion.EvalDerivative(t).ravel()
        X_WG, dt = pendulum.X_WG(q), 1e-6
        speed = (pendulum.X_WG(q + dt * v) @ X_GO - X_WG @ X_GO) / dt
        X_GO = pendulum.X_WG(q + h * v).inverse() @ (X_WG @ X_GO + h * speed)
    drift = carried_drift(pendulum, motion, p_GO, 0.5 * h)
    np.testing.assert_allclose(drift, X_GO - p_GO, rtol=0.01, atol=1e-6)


def test_the_object_of_an_arm_at_rest_stays(pendulum):
    drift = carried_drift(pendulum, turn(0.0, 0.0), np.array([0.1, 0.0, 0.0]), 0.006)
    np.testing.assert_array_equal(drift, np.zeros(3))


def test_a_free_body_must_be_placed(iiwa, home):
    def scene(X_WB):
        builder = RobotDiagramBuilder(0.0)
        plant = builder.plant()
        mug = parsing.AddModel(plant, "package://drake_srg/sdf/mug.sdf", "mug")
        parsing.AddModel(plant, "package://drake_srg/sdf/iiwa14.sdf", "arm")
        parsing.AddModel(plant, "package://drake_srg/sdf/srg.sdf", "gripper")
        for parent, child in (("world", "link_0"), ("flange", "palm")):
            frames = map(plant.GetFrameByName, (parent, child))
            plant.WeldFrames(*frames)
        if X_WB is not None:
            (body,) = plant.GetBodyIndices(mug)
            plant.SetDefaultFloatingBaseBodyPose(plant.get_body(body), X_WB)
        return PlanningScene(builder)

    with pytest.raises(ValueError, match=r"^mug::\w+: a free body without a pose"):
        scene(None)
    beside = scene(RigidTransform([1.0, 0.0, 0.0]))
    assert beside.is_free(home)
    speeds = MotionLimits.of_plant(beside).velocity
    np.testing.assert_array_equal(speeds, MotionLimits.of_plant(iiwa).velocity)
    elbow = iiwa.plant.GetFrameByName("link_4")
    iiwa.plant.SetPositions(iiwa.context, iiwa.positions(home))
    X_WE = elbow.CalcPoseInWorld(iiwa.context)
    assert not scene(X_WE).is_free(home)


@pytest.mark.parametrize(
    ("distance", "words"),
    [
        (-0.1018, "a and b overlap by 101.8 mm"),
        (0.004, "a and b are 4.0 mm apart, must be 5.0 mm"),
    ],
)
def test_a_clearance_is_told_in_words(distance, words):
    assert str(Clearance(distance, 0.005, ("a", "b"))) == words
