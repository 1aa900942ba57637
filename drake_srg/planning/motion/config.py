"""Distances, speeds and limits of the arm's motions."""

import dataclasses as dc

from drake_srg.types import positive


@dc.dataclass(kw_only=True)
class TipLimits:
    """Limits of the tip along its path; the defaults are the five-axis thesis's.

    Distance on a path is that of `moveToPose` with metric [1, 1, 1, angle_weight]: the
    norm of the tip's step and of the hand's turn times that weight.
    """

    velocity: float = dc.field(default=0.1, metadata=positive())  # m/s
    acceleration: float = dc.field(default=0.1, metadata=positive())  # m/s²
    jerk: float = dc.field(default=0.1, metadata=positive())  # m/s³
    # Distance that a turn of the hand counts as [m/rad].
    angle_weight: float = dc.field(default=0.1, metadata={"ge": 0.0})

    def slowed(self, factor: float) -> "TipLimits":
        """Return the limits of the same motions in `factor` times the time."""
        return dc.replace(
            self,
            velocity=self.velocity / factor,
            acceleration=self.acceleration / factor**2,
            jerk=self.jerk / factor**3,
        )


@dc.dataclass(kw_only=True)
class MotionConfig:
    """Distances and speeds of moves."""

    # Length of the straight lines towards a grasp and back from it [m].
    approach_distance: float = dc.field(default=0.08, metadata=positive())
    # Height of straight lines up from the object and down to its goal [m].
    lift_height: float = dc.field(default=0.08, metadata=positive())
    # Share of the arm's velocity and acceleration limits with an empty hand.
    speed: float = dc.field(default=0.9, metadata={"ge": 0.01, "le": 1.0})
    # Shares of these limits with something in the hand.
    holding_speed: float = dc.field(default=0.7, metadata={"ge": 0.01, "le": 1.0})
    holding_acceleration: float = dc.field(
        default=0.3, metadata={"ge": 0.01, "le": 1.0}
    )
    # The solver that times motions as fast as the joints allow. Importing toppra adds
    # 0.4 s to the building of the first cell; it then plans faster.
    time_parameterization: str = dc.field(
        default="toppra", metadata={"among": ("toppra", "drake")}
    )
    # Limits of the tip's motion; null: as fast as the joints allow.
    tip_limits: TipLimits | None = None
