"""Poses of the hand from a log of the arm."""

from __future__ import annotations

from pydrake.math import RigidTransform

from drake_srg.scenario import Scenario
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Vector


def hand_poses(scenario: Scenario, arm_states: Vector) -> list[RigidTransform]:
    """Return the poses of the palm in world, X_WG [m].

    Args:
        scenario: The scenario with the models of arm and gripper.
        arm_states: States [q; v] of the arm, shape (K, 2N).
    """
    plant = MakeModelsPlant(scenario)
    context = plant.CreateDefaultContext()
    arm = plant.GetModelInstanceByName("arm")
    palm = plant.GetFrameByName("palm", plant.GetModelInstanceByName("gripper"))
    poses = []
    for state in arm_states:
        plant.SetPositions(context, arm, state[: plant.num_positions(arm)])
        poses.append(palm.CalcPoseInWorld(context))
    return poses
