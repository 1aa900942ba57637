"""Configuration of the safety monitor."""

import dataclasses as dc

from drake_srg.config import Config, positive


@dc.dataclass(kw_only=True)
class WorkspaceConfig(Config):
    """A box that the tool must not leave, by its corners in world [m]."""

    min: list[float] = dc.field(
        default_factory=lambda: [-1.0, -1.0, 0.0], metadata={"length": 3}
    )
    max: list[float] = dc.field(
        default_factory=lambda: [1.0, 1.0, 1.5], metadata={"length": 3}
    )


@dc.dataclass(kw_only=True)
class BodyRegionLimits(Config):
    """Largest forces on one region of a person's body."""

    # Limit of an impact [N].
    transient: float = dc.field(default=100.0, metadata=positive())
    # Limit of a contact that lasts, such as clamping [N].
    quasi_static: float = dc.field(default=50.0, metadata=positive())


@dc.dataclass(kw_only=True)
class ForceLimitConfig(Config):
    """Power and force limiting: limits by body region, and the regions within reach."""

    # Limits by the name of a body region. The numbers come from your risk assessment.
    profile: dict[str, BodyRegionLimits] = dc.field(default_factory=dict)
    # Names in `profile` of the regions within the arm's reach. The least of their
    # limits applies.
    regions: list[str] = dc.field(default_factory=list)
    # Time for which a force above `quasi_static` counts as an impact [s].
    transient_time: float = dc.field(default=0.5, metadata={"ge": 0.0})


@dc.dataclass(kw_only=True)
class SafetyConfig(Config):
    """Limits of the arm's motion, for any source of commands.

    A list has one entry for all joints, or one per joint.
    """

    # Joint positions [rad or m]; null: the model's limits.
    lower: list[float] | None = None
    upper: list[float] | None = None
    # Joint speeds [rad/s or m/s]; null: the model's limits.
    speed: list[float] | None = dc.field(default=None, metadata=positive())
    # Accelerations of commands [rad/s² or m/s²]; null: 1.5 times the model's limits,
    # because a planner that uses a joint's full acceleration needs up to 1.5 times as
    # much to stop along its path.
    acceleration: list[float] | None = dc.field(default=None, metadata=positive())
    # Decelerations of stops; null: 4/3 of `acceleration`. They must exceed
    # `acceleration`, because a motion that already brakes must be able to brake harder.
    stop_acceleration: list[float] | None = dc.field(default=None, metadata=positive())
    # The tool: a frame of the models, as MODEL::FRAME.
    tool: str = "gripper::grasp_center"
    # Largest speed of the tool's origin [m/s], and its workspace; null: no limit.
    tool_speed: float | None = dc.field(default=None, metadata=positive())
    workspace: WorkspaceConfig | None = None
    # Largest external torques [N m], which include the weight of a load in the hand;
    # null: no limit.
    external_torque: list[float] | None = dc.field(default=None, metadata=positive())
    # Limits of the force at the tool. It is the force there that best explains the
    # external torques.
    force: ForceLimitConfig | None = None
    # Largest deviation of the measured joints from the monitor's commands [rad or m];
    # null: no limit.
    following_error: float | None = dc.field(default=0.25, metadata=positive())
    # Age at which the newest message is stale [s]; needs the input `safety.heartbeat`.
    watchdog: float = dc.field(default=0.05, metadata=positive())
    # Speed along the path, as a share of the commanded speed. Below 1, motions take
    # longer than planned, so raise `planner.arrival_timeout`.
    speed_override: float = dc.field(default=1.0, metadata={"ge": 0.0, "le": 1.0})
    # Longest time by which commands may be ahead of a slowed arm [s].
    path_memory: float = dc.field(default=4.0, metadata=positive())

    @property
    def needs_tool(self) -> bool:
        """Whether a limit needs the tool's position."""
        limits = (self.tool_speed, self.workspace, self.force)
        return any(limit is not None for limit in limits)

    @property
    def feels(self) -> bool:
        """Whether a limit needs the arm's external torques."""
        return self.external_torque is not None or self.force is not None
