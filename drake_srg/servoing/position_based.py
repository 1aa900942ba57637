"""Visual servoing on an object's pose."""

from __future__ import annotations

from pydrake.math import RigidTransform

from drake_srg.servoing.arm import ServoArm
from drake_srg.servoing.config import ServoConfig
from drake_srg.servoing.sightings import PoseSighting
from drake_srg.servoing.status import ServoFault
from drake_srg.servoing.visual_servo import VisualServo
from drake_srg.types import Vector


class PositionBasedServo(VisualServo):
    """Drives the hand until the camera sees an object in the pose that it must have.

    .. pydrake_system::

        name: PositionBasedServo
        input_ports:
        - command
        - position_planned
        - arm_state
        - sighting
        output_ports:
        - position_commanded
        - status

    The ports are those of `VisualServo`; `sighting` is a PoseSighting. The error is the
    object's pose in the camera against `X_CO_goal`. Without `config.turns`, only the
    translation counts.

    Args:
        arm: Kinematics of arm and hand.
        X_GC: Where the camera is believed to be in the hand [m].
        axis_G: Direction of approach in the hand, a unit vector, shape (3,).
        X_CO_goal: Pose of the object in the camera with the hand at its goal [m].
        config: Gains and limits.
    """

    def __init__(
        self,
        arm: ServoArm,
        X_GC: RigidTransform,
        axis_G: Vector,
        X_CO_goal: RigidTransform,
        config: ServoConfig | None = None,
    ) -> None:
        config = config or ServoConfig()
        super().__init__(arm, X_GC, axis_G, PoseSighting(), config)
        self._X_CO_goal = X_CO_goal

    def goal_camera(self, sighting: PoseSighting) -> RigidTransform | ServoFault:
        """Return the camera's goal, seen from where it is; see `VisualServo`."""
        X_CO = sighting.X_CO
        if X_CO is None:
            return ServoFault.LOST
        if self.config.turns:
            return X_CO @ self._X_CO_goal.inverse()
        away = X_CO.translation() - self._X_CO_goal.translation()
        return RigidTransform(away)
