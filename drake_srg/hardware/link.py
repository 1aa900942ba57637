"""The interface between a hardware station and a driver of real hardware."""

from __future__ import annotations

import abc
import dataclasses as dc
import threading
from collections.abc import Mapping, Set
from typing import TYPE_CHECKING, Any

from drake_srg.bridges.commands import PortValues, Warnings
from drake_srg.scenario import Scenario
from drake_srg.types import Vector

if TYPE_CHECKING:
    from drake_srg.hardware.nodes import Nodes

# The time by the robot's clock of the newest measurement, shape (1,) [s].
STAMP = "hardware.stamp"
# What the arm's joints feel from outside, shape (N,) [N m]; only some arms tell it.
EXTERNAL_TORQUE = "arm.external_torque"


class Link(abc.ABC):
    """A live connection to a part of a robot.

    Threads of the link talk to the hardware. `take` and `send` are called by the thread
    that runs the control loop, every control period, and return at once.

    Attributes:
        outputs: Sizes of the station's output ports that the link measures, by name.
        lag: How long after a command the hardware is to be there [s].
    """

    outputs: Mapping[str, int] = {}
    lag: float = 0.0

    @abc.abstractmethod
    def take(self) -> PortValues:
        """Return what has been measured since the last call, by output port.

        An empty mapping says that nothing has arrived. Values are finite and have the
        ports' sizes; a link refuses whatever is not, and warns. A message that arrives
        out of order or twice does not count as new. `STAMP` may be among the keys.
        """

    @abc.abstractmethod
    def send(self, commands: PortValues) -> None:
        """Command the hardware; a failure to do so must not raise.

        Args:
            commands: By the station's input port, in its units:
                `arm.position_commanded` (N) [rad or m], already within the limits of
                the safety monitor; `gripper.closure_commanded` (1), 0 open .. 1
                closed; or `gripper.hold` (1), nonzero while the gripper is to stay
                where it is and keep its grip. A link ignores ports that are not its
                own.
        """

    @abc.abstractmethod
    def close(self) -> None:
        """Disconnect, leaving the hardware where it is. A second call does nothing."""


class Mailbox:
    """Keeps the newest values that threads put in until the control loop takes them."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._values: dict[str, Vector] = {}

    def put(self, values: PortValues) -> None:
        """Add values; a newer one replaces an older one of the same name."""
        with self._lock:
            self._values.update(values)

    def take(self, needed: Set[str] = frozenset()) -> dict[str, Vector]:
        """Return the values since the last call, or none until all needed ones are new.

        Args:
            needed: Their names.
        """
        with self._lock:
            if needed - self._values.keys():
                return {}
            values, self._values = self._values, {}
        return values


@dc.dataclass(frozen=True)
class Robot:
    """What a driver may know of the robot that it is a part of.

    Attributes:
        scenario: The scenario that runs on the hardware.
        arm_joints: Names of the arm's joints, in the order of its ports.
        arm_limits: Least and greatest position of each, shape (N,) [rad or m].
        warnings: Where trouble is reported to the user, once for each kind.
        nodes: ROS nodes, which drivers share.
        shared: Whatever else drivers share, such as a bus; empty at first.
    """

    scenario: Scenario
    arm_joints: tuple[str, ...]
    arm_limits: tuple[Vector, Vector]
    warnings: Warnings
    nodes: Nodes
    shared: dict[Any, Any] = dc.field(default_factory=dict)

    @property
    def gripper_joints(self) -> tuple[str, ...]:
        """Names of the gripper's measured joints, in the order of its ports."""
        gripper = self.scenario.gripper
        return () if gripper is None else gripper.joint_names

    @property
    def finger_sensors(self) -> tuple[str, ...]:
        """Names of the gripper's finger sensors, in the order of its ports."""
        gripper = self.scenario.gripper
        return () if gripper is None else gripper.sensor_names


class HardwareDriver(abc.ABC):
    """Configuration of a driver, which a YAML tag chooses in a hardware file.

    An arm's link measures `arm.state_measured` (2N), [q; v], and perhaps
    `arm.torque_measured` (N) and `arm.external_torque` (N) [N m]. A gripper's link
    measures `gripper.state_measured` (2n), [q; v]; `gripper.triggered` (m), nonzero
    where a finger sensor fires, from which the station tells `gripper.grasped`;
    `gripper.proximity` (m) [m]; and perhaps `gripper.contact_force` (m) [N] and
    `gripper.pwm`. A gripper without finger sensors tells by other means, such as
    currents, and says 0 or `proximity.range` as the distance.
    """

    @abc.abstractmethod
    def connect(self, robot: Robot) -> Link:
        """Return a link to the hardware.

        The station waits for its first measurements afterwards, so this need not.

        Raises:
            ScenarioError: If the configuration does not fit the robot.
            OSError: If the hardware cannot be reached.
            ImportError: If a package is missing.
        """
