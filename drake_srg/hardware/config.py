"""Hardware files: which drivers a robot needs."""

import dataclasses as dc
import functools
import operator
import typing
from pathlib import Path

from drake_srg.bridges.connecting import Ros1Config, Ros2Config
from drake_srg.common.exceptions import ScenarioError
from drake_srg.hardware.arm import Ros1Arm, Ros2Arm
from drake_srg.hardware.cameras import Ros1Camera, Ros2Camera, RosCamera
from drake_srg.hardware.dynamixel.drivers import DynamixelArm, DynamixelGripper
from drake_srg.hardware.faults import FaultsConfig
from drake_srg.hardware.gripper import Ros1Gripper, Ros2Gripper
from drake_srg.hardware.link import HardwareDriver, RosDriver
from drake_srg.scenario.yaml_tree import parse_yaml
from drake_srg.scenario.yaml_typed import load_typed

# The drivers that a tag selects from.
ARMS = (Ros1Arm, Ros2Arm, DynamixelArm)
GRIPPERS = (Ros1Gripper, Ros2Gripper, DynamixelGripper)
CAMERAS = (Ros1Camera, Ros2Camera)

if typing.TYPE_CHECKING:
    _Arm: typing.TypeAlias = HardwareDriver
    _Gripper: typing.TypeAlias = HardwareDriver
    _Camera: typing.TypeAlias = RosCamera
else:
    _Arm, _Gripper, _Camera = (
        functools.reduce(operator.or_, kinds) for kinds in (ARMS, GRIPPERS, CAMERAS)
    )


@dc.dataclass(kw_only=True)
class HardwareConfig:
    """The drivers of a robot's parts."""

    # Both are needed in a file; Drake's reader wants defaults.
    arm: _Arm = dc.field(default_factory=Ros2Arm)
    gripper: _Gripper = dc.field(default_factory=Ros2Gripper)
    # Cameras by their names in the scenario; the localizer's are needed.
    cameras: dict[str, _Camera] = dc.field(default_factory=dict)
    # The nodes of the drivers that speak ROS.
    ros1: Ros1Config = dc.field(default_factory=Ros1Config)
    ros2: Ros2Config = dc.field(default_factory=Ros2Config)
    # How long to wait for the first measurements and pictures [s].
    patience: float = dc.field(default=30.0, metadata={"gt": 0.0})
    # Seconds of ours per real second. Anything but 1 is for a served simulation that is
    # as slow (`drake-srg serve --rate`), on a machine that is too busy for real time.
    rate: float = dc.field(default=1.0, metadata={"gt": 0.0})
    # How long a stopped arm waits for a release, after which the run goes on [s, real];
    # 0: a stop ends the run.
    release: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # Faults that the wires do not have by themselves; null: none.
    faults: FaultsConfig | None = None

    @property
    def ros_versions(self) -> set[int]:
        """Versions of ROS that parts of the robot speak."""
        parts = (self.arm, self.gripper, *self.cameras.values())
        return {p.version for p in parts if isinstance(p, RosDriver | RosCamera)}


def load_hardware(path: str | Path) -> HardwareConfig:
    """Load a hardware file.

    Raises:
        ScenarioError: If it cannot be read, or is invalid.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ScenarioError(f"{path}: cannot be read: {reason}") from None
    return parse_hardware(text, path.name)


def parse_hardware(text: str, origin: str) -> HardwareConfig:
    """Return the configuration that the text of a hardware file describes.

    Args:
        text: Of the file.
        origin: Its name, for error messages.

    Raises:
        ScenarioError: If it is invalid.
    """
    tree = parse_yaml(text, origin) or {}
    for key in ("arm", "gripper"):
        if not isinstance(tree, dict) or key not in tree:
            kinds = ARMS if key == "arm" else GRIPPERS
            allowed = ", ".join(f"!{kind.__name__}" for kind in kinds)
            raise ScenarioError(f"{origin}: {key}: missing (allowed: {allowed})")
    config: HardwareConfig = load_typed(HardwareConfig, tree, origin)
    return config
