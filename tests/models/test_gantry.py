"""The gantry: motion, strength, and room for the hand."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.geometry import Role
from pydrake.math import RigidTransform, RotationMatrix

from models.built_models import Built, build, mesh_points


def test_joint_positions_are_the_flanges_position():
    built = build("gantry")
    flange = built.plant.GetFrameByName("flange")
    for q in ([0.0, 0.0, 0.0], [0.4, -0.3, 0.8]):
        built.plant.SetPositions(built.plant_context, q)
        X_WF = flange.CalcPoseInWorld(built.plant_context)
        assert X_WF.IsNearlyEqualTo(RigidTransform(q), 1e-12)
    assert [
        built.plant.get_joint_actuator(a).name()
        for a in built.plant.GetJointActuatorIndices()
    ] == ["gantry_x", "gantry_y", "gantry_z"]


def test_a_turret_turns_the_flange_about_the_vertical():
    built = build("gantry_turning")
    built.plant.SetPositions(built.plant_context, [0.1, -0.2, 0.3, 0.7])
    X_WF = built.plant.GetFrameByName("flange").CalcPoseInWorld(built.plant_context)
    expected = RigidTransform(RotationMatrix.MakeZRotation(0.7), [0.1, -0.2, 0.3])
    assert X_WF.IsNearlyEqualTo(expected, 1e-12)


def test_limits_allow_shaking_5_kg_at_1_g():
    plant = build("gantry").plant
    amplitude = 9.81 / (2 * np.pi * 2.0) ** 2  # m, at 2 Hz
    assert np.all(plant.GetPositionUpperLimits() > amplitude)
    assert np.all(plant.GetVelocityUpperLimits() > 2 * np.pi * 2.0 * amplitude)
    assert np.all(plant.GetAccelerationUpperLimits() > 9.81)
    stand = plant.GetBodyByName("stand").default_mass()
    total = plant.CalcTotalMass(plant.CreateDefaultContext())
    moved = total - stand + 0.4 + 5.0  # with gripper and payload
    assert np.all(plant.GetEffortUpperLimits() > moved * 2 * 9.81)


# Space of a hand at the flange [m]: fingers sweep 0.15 to each side and reach 0.19.
@pytest.mark.parametrize(
    ("low", "high"),
    [
        ((-0.1, -0.3, -0.5), (0.3, 0.3, -0.03)),  # points down
        ((0.05, -0.3, -0.3), (0.3, 0.3, 0.3)),  # to the front
        ((-0.1, -0.3, 0.03), (0.3, 0.3, 0.3)),  # up
        ((-0.14, 0.05, -0.3), (0.3, 0.3, 0.3)),  # to the side
    ],
)
def test_stays_out_of_the_hands_way(low, high):
    built = Built("gantry")
    for q in ([0, 0, 0.3], [-0.4, 0.4, 0.6], [0.4, -0.4, 0.6]):
        built.plant.SetPositions(built.plant_context, q)
        for body in built.bodies():
            X_WB = built.plant.EvalBodyPoseInWorld(built.plant_context, body)
            for label, shape, X_BG in built.shapes(body, Role.kIllustration):
                p = ((X_WB @ X_BG) @ mesh_points(shape).T).T - q
                inside = np.all((p > low) & (p < high), axis=1)
                assert not np.any(inside), (label, q)
