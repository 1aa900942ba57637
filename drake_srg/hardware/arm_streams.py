"""How an arm gets its commands: a message of a topic each control period."""

from __future__ import annotations

import math
from collections.abc import Sequence

from drake_srg.hardware.messages import joint_trajectory
from drake_srg.hardware.nodes import Node
from drake_srg.hardware.window import Window
from drake_srg.recording.ros_topics import float64_array
from drake_srg.types import Vector


class ArmStream:
    """The way of the commands to an arm.

    Attributes:
        lag: How long after a command the arm is to be there [s].
        fails: Whether the arm obeys no more. The link then falls silent, so that the
            safety monitor stops.
    """

    lag: float = 0.0
    fails: bool = False

    def send(self, q: Vector, stamp: float, *, stopped: bool) -> None:
        """Send a command; called every control period.

        Args:
            q: Positions, shape (N,) [rad or m].
            stamp: The robot's clock, as far as it is known; -inf: not at all [s].
            stopped: Whether the safety monitor stops the arm, or has stopped it.
        """
        raise NotImplementedError

    def close(self) -> None:
        """Leave the arm where it is; the node is still open."""


class PositionStream(ArmStream):
    """Sends the newest positions, to be taken at once.

    Args:
        node: The node; not yet open.
        topic: Name of the std_msgs/Float64MultiArray.
        size: Number of joints.
    """

    def __init__(self, node: Node, topic: str, size: int) -> None:
        self._node = node
        self._topic = float64_array(topic, "arm.position_commanded", size)
        node.publish(self._topic)

    def send(self, q: Vector, stamp: float, *, stopped: bool) -> None:
        """See `ArmStream`."""
        self._node.send(self._topic, 0.0, q)


class TrajectoryStream(ArmStream):
    """Sends the positions around now, with times by the robot's clock.

    Args:
        node: The node; not yet open.
        topic: Name of the trajectory_msgs/JointTrajectory.
        joints: Names of the joints.
        lead: How far ahead the newest command is [s].
        period: Between commands [s].
    """

    def __init__(
        self, node: Node, topic: str, joints: Sequence[str], lead: float, period: float
    ) -> None:
        self.lag = lead
        self._node, self._window = node, Window(lead, period)
        self._topic = joint_trajectory(topic, joints)
        node.publish(self._topic)

    def send(self, q: Vector, stamp: float, *, stopped: bool) -> None:
        """See `ArmStream`."""
        if math.isfinite(stamp):
            times, positions = self._window.after(q, stamp)
            self._node.send(self._topic, 0.0, times, positions)
