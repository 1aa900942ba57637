"""A condition of your own in inverse kinematics: the elbow stays above 0.6 m."""

from typing import Any

import numpy as np
from pydrake.multibody.inverse_kinematics import InverseKinematics

from drake_srg.planning import HandTarget, PlanningScene, solve_inverse_kinematics


def reach(scene: PlanningScene, target: HandTarget, q_home: Any) -> Any:
    """Return a posture with the elbow up, or why there is none."""
    plant = scene.plant
    elbow = plant.GetFrameByName("link_4", plant.GetModelInstanceByName("arm"))

    def keep_elbow_up(ik: InverseKinematics) -> None:
        up = ik.AddPositionConstraint(
            elbow, np.zeros(3), plant.world_frame(), [-9, -9, 0.6], [9, 9, 9]
        )
        up.evaluator().set_description("elbow up")

    return solve_inverse_kinematics(
        scene, target, q_nominal=q_home, extend=keep_elbow_up
    )
