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
    """Power and force limiting: a profile of limits, and the regions within reach."""

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
    # Accelerations of commands [rad/s² or m/s²]; null: 1.5 times the model's limits. A
    # planner that uses a joint's full acceleration stops along its path with up to 1.5
    # times as much.
    acceleration: list[float] | None = dc.field(default=None, metadata=positive())
    # Decelerations of stops; null: 4/3 of `acceleration`. It must exceed
    # `acceleration`, or a motion that already brakes could not brake harder.
    stop_acceleration: list[float] | None = dc.field(default=None, metadata=positive())
    # The tool: a frame of the models, as MODEL::FRAME.
    tool: str = "gripper::grasp_center"
    # Largest speed of the tool's origin [m/s], and its workspace; null: no limit.
    tool_speed: float | None = dc.field(default=None, metadata=positive())
    workspace: WorkspaceConfig | None = None
    # Largest external torques [N m], without and with the load in the hand; null: no
    # limit.
    external_torque: list[float] | None = dc.field(default=None, metadata=positive())
    # Limits of the force at the tool that best explains the external torques.
    force: ForceLimitConfig | None = None
    # Largest deviation of the measured joints from the monitor's commands [rad or m];
    # null: no limit.
    following_error: float | None = dc.field(default=0.25, metadata=positive())
    # Age at which the newest message is stale [s]; needs `safety.heartbeat`.
    watchdog: float = dc.field(default=0.05, metadata=positive())
    # Speed along the path, as a share of the commanded speed. With less than 1, motions
    # take longer than planned: raise `planner.arrival_timeout`.
    speed_override: float = dc.field(default=1.0, metadata={"ge": 0.0, "le": 1.0})
    # Largest lead of the commands over a slowed arm [s].
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
