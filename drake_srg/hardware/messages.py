"""What ROS messages carry from and to a robot, checked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from drake_srg.bridges.commands import CommandError
from drake_srg.bridges.trajectory_topics import seconds
from drake_srg.common.exceptions import ScenarioError
from drake_srg.types import Vector

JOINT_STATE = "sensor_msgs/msg/JointState"
ARRAY = "std_msgs/msg/Float64MultiArray"
# A robot that was silent for this long has been given up. [s]
_LONGEST_GAP = 5.0


def numbers(data: Any, size: int) -> Vector:
    """Return the finite numbers of a message, shape (size,).

    Raises:
        CommandError: If there are more or fewer, or one of them is not finite.
    """
    values = np.array(data, dtype=np.float64)
    if values.shape != (size,):
        raise CommandError("length", f"needs {size} numbers, got {values.size}")
    if not np.isfinite(values).all():
        raise CommandError("finite", "needs finite numbers, got NaN or infinity")
    return values


class JointStates:
    """Reads the states of some joints from sensor_msgs/JointState messages.

    Args:
        names: Of the joints, in the wanted order.

    Attributes:
        stamp: Time of the newest message [s].
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names, self.stamp = tuple(names), -math.inf
        self._jumped = math.inf

    def read(self, message: Any) -> tuple[float, Vector, Vector | None] | None:
        """Return stamp [s], state [q; v] and efforts; None if no joint is among it.

        Efforts are None where a message lacks them, or they are not finite.

        Raises:
            CommandError: If the message is not newer than the last one, jumps ahead
                and no second one confirms that, or lacks some of the joints or their
                finite positions and velocities.
        """
        given = list(message.name)
        if not set(self._names) & set(given):
            return None
        missing = sorted(set(self._names) - set(given))
        if missing:
            raise CommandError("joints", f"lacks the joints {', '.join(missing)}")
        count, stamp = len(given), seconds(message.header.stamp)
        q, v = numbers(message.position, count), numbers(message.velocity, count)
        self._check(stamp)
        self.stamp = stamp
        order = [given.index(name) for name in self._names]
        effort = np.array(message.effort, dtype=np.float64)
        told = effort.shape == (count,) and bool(np.isfinite(effort[order]).all())
        return (
            stamp,
            np.concatenate([q[order], v[order]]),
            effort[order] if told else None,
        )

    def _check(self, stamp: float) -> None:
        if stamp <= self.stamp:
            raise CommandError(
                "stamp",
                f"needs a newer time than {self.stamp:.3f} s, got {stamp:.3f} s",
            )
        # One wrong stamp far ahead must not make all that follow look old; a second
        # one tells that the robot was silent.
        jumps = math.isfinite(self.stamp) and stamp > self.stamp + _LONGEST_GAP
        if jumps and not 0.0 < stamp - self._jumped <= _LONGEST_GAP:
            self._jumped = stamp
            raise CommandError(
                "stamp", f"jumps ahead from {self.stamp:.3f} s to {stamp:.3f} s"
            )


def joint_names(part: str, given: Sequence[str], model: Sequence[str]) -> Sequence[str]:
    """Return the given names of a part's joints, or the model's."""
    if given and len(given) != len(model):
        raise ScenarioError(
            f"{part}.joints: needs one name for each of {', '.join(model)}, "
            f"got {len(given)}"
        )
    if len(set(given)) < len(given):
        raise ScenarioError(f"{part}.joints: names must differ, got {', '.join(given)}")
    return given or model
