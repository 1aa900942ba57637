"""The iiwa 14: kinematics, limits, self-contact."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from models.built_models import SEED, Built, build


def flange_by_dh(q: np.ndarray) -> RigidTransform:
    """Return the flange's pose by KUKA's Denavit-Hartenberg parameters.

    The model does not use them, so they check it.
    """
    h = np.pi / 2
    X = RigidTransform()
    for angle, alpha, d in zip(
        q,
        (-h, h, h, -h, -h, h, 0),
        (0.36, 0, 0.42, 0, 0.40, 0, 0.126),
        strict=True,
    ):
        X = (
            X
            @ RigidTransform(RotationMatrix.MakeZRotation(angle), [0, 0, d])
            @ RigidTransform(RotationMatrix.MakeXRotation(alpha), [0, 0, 0])
        )
    return X


@pytest.mark.parametrize(
    "q",
    [
        np.zeros(7),
        np.array([0, 0.6, 0, -1.5, 0, 1.0, 0]),
        np.array([0.4, -0.7, 1.1, 1.3, -0.9, 0.5, 2.0]),
    ],
)
def test_flange_pose_agrees_with_the_dh_parameters(q):
    built = build("iiwa14")
    built.plant.SetPositions(built.plant_context, q)
    flange = built.plant.GetFrameByName("flange")
    X_WF = flange.CalcPoseInWorld(built.plant_context)
    assert X_WF.IsNearlyEqualTo(flange_by_dh(q), 1e-6)


def test_limits_match_the_public_description():
    plant = build("iiwa14").plant
    names = [
        plant.get_joint_actuator(a).name() for a in plant.GetJointActuatorIndices()
    ]
    assert names == [f"joint_{i}" for i in range(1, 8)]
    upper = np.radians([170, 120, 170, 120, 170, 120, 175])
    np.testing.assert_allclose(plant.GetPositionUpperLimits(), upper, atol=1e-6)
    np.testing.assert_allclose(plant.GetPositionLowerLimits(), -upper, atol=1e-6)
    speed = np.radians([85, 85, 100, 75, 130, 135, 135])
    np.testing.assert_allclose(plant.GetVelocityUpperLimits(), speed, atol=1e-6)
    np.testing.assert_allclose(
        plant.GetAccelerationUpperLimits(),
        [8.57, 8.57, 8.74, 11.36, 12.23, 15.72, 15.72],
    )
    np.testing.assert_allclose(
        plant.GetEffortUpperLimits(), [320, 320, 176, 176, 110, 40, 40]
    )


def test_does_not_touch_itself_in_working_poses():
    built = Built("iiwa14")
    rng = np.random.default_rng(SEED)
    upper = built.plant.GetPositionUpperLimits()
    # Folded further, the wrist may meet the foot, as on the real arm.
    reach = np.array([1, 0.75, 1, 0.9, 1, 1, 1])
    for _ in range(200):
        q = rng.uniform(-upper, upper) * reach
        built.plant.SetPositions(built.plant_context, q)
        assert not built.touching(), q
