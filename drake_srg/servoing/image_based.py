"""Visual servoing on points in the image."""

from __future__ import annotations

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.servoing.arm import ServoArm
from drake_srg.servoing.config import ServoConfig
from drake_srg.servoing.interaction import image_displacement
from drake_srg.servoing.sightings import FeatureSighting
from drake_srg.servoing.status import ServoFault
from drake_srg.servoing.visual_servo import VisualServo
from drake_srg.types import Vector


class ImageBasedServo(VisualServo):
    """Drives the hand until image points are where they must be.

    .. pydrake_system::

        name: ImageBasedServo
        input_ports:
        - command
        - position_planned
        - arm_state
        - sighting
        output_ports:
        - position_commanded
        - status

    The ports are those of `VisualServo`; `sighting` is a FeatureSighting with as many
    points as `goal`. The error of the points in the image goes through the damped
    inverse of their interaction matrix (see `image_displacement`). Where that is nearly
    singular, the hand is held.

    Args:
        arm: Kinematics of arm and hand.
        X_GC: Where the camera is believed to be in the hand [m]; only its orientation
            matters without `config.turns`.
        axis_G: Direction of approach in the hand, a unit vector, shape (3,).
        goal: The points with the hand at its goal.
        config: Gains and limits.
    """

    def __init__(
        self,
        arm: ServoArm,
        X_GC: RigidTransform,
        axis_G: Vector,
        goal: FeatureSighting,
        config: ServoConfig | None = None,
    ) -> None:
        config = config or ServoConfig()
        super().__init__(arm, X_GC, axis_G, FeatureSighting(), config)
        self._goal = goal

    def goal_camera(self, sighting: FeatureSighting) -> RigidTransform | ServoFault:
        """Return the camera's goal, seen from where it is; see `VisualServo`."""
        if not len(sighting.points):
            return ServoFault.LOST
        found = image_displacement(
            sighting.points,
            sighting.depths,
            self._goal.points,
            self._goal.depths,
            turns=self.config.turns,
            least=self.config.least_interaction,
        )
        if found.least < self.config.least_interaction:
            return ServoFault.SINGULAR
        move, turn = found.x[:3], found.x[3:]
        angle = float(np.linalg.norm(turn))
        axis = turn / angle if angle > 0.0 else np.array([0.0, 0.0, 1.0])
        return RigidTransform(RotationMatrix(AngleAxis(angle, axis)), move)
