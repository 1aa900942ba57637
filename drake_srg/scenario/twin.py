"""Configuration of a digital twin: when robot and model part."""

import dataclasses as dc

from drake_srg.types import positive


@dc.dataclass(kw_only=True)
class TwinConfig:
    """Differences between a robot and its twin that are reported; see docs/twin.md."""

    # Time between samples of the twin, in place of `arm.period` [s]: at long periods, a
    # twin lags behind, and misses pictures that arrive at once. Null: `arm.period`.
    period: float | None = dc.field(default=None, metadata=positive())
    # Largest difference between a measured joint of the arm and the twin's, which
    # follows it [rad or m]. It does so two control periods late: 0.05 rad at the
    # fastest joint's top speed in the fast kitchen.
    joint: float = dc.field(default=0.1, metadata=positive())
    # Largest difference between measured and expected torques of the arm, as a share of
    # the joint's effort limit. The iiwa's axis-specific torque accuracy is 2 % (KUKA,
    # LBR iiwa, technical data).
    torque: float = dc.field(default=0.02, metadata=positive())
    # Joint speed above which torques do not count [rad/s or m/s]: acceleration and
    # friction are known less well. The arm must have been slower for this long, and the
    # torque must have differed for as long [s]; the comparison's time constant is
    # 0.02 s. The planner's shortest rest is 0.3 s.
    still_speed: float = dc.field(default=0.005, metadata=positive())
    still_time: float = dc.field(default=0.1, metadata={"ge": 0.0})
    # Largest difference between a measured finger joint and the twin's [rad]. Fingers
    # around cans of 60 and 66 mm differ by 0.1 rad.
    finger: float = dc.field(default=0.1, metadata=positive())
    # Largest distance between where a camera sees an object and where the twin has it
    # [m]. Half hidden by the hand, an object is seen up to 10 mm off.
    object: float = dc.field(default=0.03, metadata=positive())
    # How long a difference must last to be reported [s]: the fingers' commands arrive
    # up to 0.1 s early or late.
    patience: float = dc.field(default=0.3, metadata={"ge": 0.0})
    # Nothing is reported for this time [s] at first, and after messages that were more
    # than `patience` apart: the twin's fingers need it to reach their command.
    settle: float = dc.field(default=2.0, metadata={"ge": 0.0})
    # The twin ends when the robot has been silent for this long [s, real].
    silence: float = dc.field(default=3.0, metadata=positive())
    # Topics of what cameras see, std_msgs/String as `serve` publishes it, and of the
    # commands to the gripper: std_msgs/Float64, 0 open .. 1 closed, and std_msgs/Int32,
    # 0 open .. 100 closed. Empty: there is none.
    blobs: str = "/blobs"
    closure: str = "/gripper/closure_commanded"
    grasp: str = "/grasp"
