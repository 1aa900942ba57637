"""Hardware files: a robot's drivers, and faults to inject."""

import dataclasses as dc
import functools
import operator
import typing
from collections import deque
from collections.abc import Callable
from pathlib import Path

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.config import Config
from drake_srg.robot.drive.arm import Ros1Arm, Ros2Arm
from drake_srg.robot.drive.cameras import Ros1Camera, Ros2Camera, RosCamera
from drake_srg.robot.drive.dynamixel.drivers import DynamixelArm, DynamixelGripper
from drake_srg.robot.drive.gripper import Ros1Gripper, Ros2Gripper
from drake_srg.robot.drive.link import HardwareDriver, Link, RosDriver
from drake_srg.robot.serve.commands import PortValues
from drake_srg.robot.serve.connecting import Ros1Config, Ros2Config
from drake_srg.scenario.typed_yaml import load_typed, parse_yaml


@dc.dataclass(kw_only=True)
class FaultsConfig(Config):
    """Latency and loss that are added to those of the network."""

    # Delay of measurements and of commands, each [s]; rounded to control periods.
    latency: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # Share of messages that are dropped, in each direction.
    loss: float = dc.field(default=0.0, metadata={"ge": 0.0, "le": 1.0})
    seed: int = dc.field(default=0, metadata={"ge": 0})


class FaultyLink(Link):
    """A link that delays messages and drops some.

    Args:
        period: Time between calls of `take`, and of `send` [s].
    """

    def __init__(self, link: Link, config: FaultsConfig, period: float) -> None:
        self.outputs = link.outputs
        self.lag = link.lag + 2.0 * config.latency
        self._link = link
        self._random = np.random.default_rng(config.seed)
        self._loss = config.loss
        late = round(config.latency / period)
        self._taken: deque[PortValues] = deque([{}] * late)
        self._sent: deque[PortValues | None] = deque([None] * late)

    def take(self) -> PortValues:
        """Return what has been measured since the last call, by output port."""
        self._taken.append(self._pass(self._link.take) or {})
        return self._taken.popleft()

    def send(self, commands: PortValues) -> None:
        """Command the hardware; a failure to do so must not raise."""
        self._sent.append(self._pass(lambda: commands))
        due = self._sent.popleft()
        if due is not None:
            self._link.send(due)

    def close(self) -> None:
        """Disconnect, leaving the hardware where it is. A second call does nothing."""
        self._link.close()

    def _pass(self, get: Callable[[], PortValues]) -> PortValues | None:
        """Return a message, or None if it is dropped."""
        values = get()
        return None if self._random.random() < self._loss else values


# The drivers that a YAML tag may name.
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
class ArmHardware(Config):
    """The drivers of an arm and its gripper."""

    # A file must name both. The defaults are for Drake's reader, which needs them.
    arm: _Arm = dc.field(default_factory=Ros2Arm)
    gripper: _Gripper = dc.field(default_factory=Ros2Gripper)


@dc.dataclass(kw_only=True)
class HardwareConfig(ArmHardware):
    """The drivers of a robot's parts."""

    # Drivers of several arms, by the arms' names in the scenario. `arm` and `gripper`
    # are the short form for a single arm, and must be absent with `arms`.
    arms: dict[str, ArmHardware] = dc.field(default_factory=dict)
    # Cameras by their names in the scenario. Those of the localizer are required.
    cameras: dict[str, _Camera] = dc.field(default_factory=dict)
    # The nodes of the drivers that speak ROS.
    ros1: Ros1Config = dc.field(default_factory=Ros1Config)
    ros2: Ros2Config = dc.field(default_factory=Ros2Config)
    # Time to wait for the first measurements and pictures [s].
    patience: float = dc.field(default=30.0, metadata={"gt": 0.0})
    # Seconds of our clock per real second. A value other than 1 is for a simulation
    # served at that rate (`drake-srg serve --rate`), on a machine too slow for 1.
    rate: float = dc.field(default=1.0, metadata={"gt": 0.0})
    # Time that a stopped arm waits for a release, after which the run goes on
    # [s, real]; 0: a stop ends the run.
    release: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # Faults to inject; null: none.
    faults: FaultsConfig | None = None

    @property
    def drivers(self) -> dict[str, ArmHardware]:
        """Drivers of each arm, by the arm's name; a single arm has the name ""."""
        return self.arms or {"": self}

    @property
    def ros_versions(self) -> set[int]:
        """Versions of ROS that the drivers speak."""
        arms = self.drivers.values()
        drivers = [part for arm in arms for part in (arm.arm, arm.gripper)]
        parts = (*drivers, *self.cameras.values())
        return {p.version for p in parts if isinstance(p, RosDriver | RosCamera)}


def load_hardware(path: str | Path) -> HardwareConfig:
    """Load a hardware file.

    Raises:
        ScenarioError: If the file cannot be read, or is invalid.
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

    Raises:
        ScenarioError: If the text is invalid.
    """
    tree = parse_yaml(text, origin) or {}
    places = {"": tree}
    if isinstance(tree, dict) and isinstance(tree.get("arms"), dict) and tree["arms"]:
        places = {f"arms.{name}.": each for name, each in tree["arms"].items()}
    for place, given in places.items():
        for key, kinds in (("arm", ARMS), ("gripper", GRIPPERS)):
            if not isinstance(given, dict) or key not in given:
                allowed = ", ".join(f"!{kind.__name__}" for kind in kinds)
                where = f"{origin}: {place}{key}"
                raise ScenarioError(f"{where}: missing (allowed: {allowed})")
            if place and key in tree:
                raise ScenarioError(f"{origin}: {key}: must be absent with arms")
    config: HardwareConfig = load_typed(HardwareConfig, tree, origin)
    return config
