"""Messages of a robot that are not as they must be."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Sequence

import numpy as np

from drake_srg.experiments.direct_node import DirectNode, make_message
from drake_srg.recording.rosbag import header
from drake_srg.types import Vector


@dc.dataclass
class Told:
    """What a robot tells in a control period, to be spoilt.

    Attributes:
        stamp: [s].
        names: Of the joints, the arm's n first.
        q: Their positions [rad].
        v: Their speeds [rad/s].
        near: The finger sensors' distances [m].
        n: Number of the arm's joints.
        period: The control period [s].
    """

    stamp: float
    names: list[str]
    q: Vector
    v: Vector
    near: Vector
    n: int
    period: float

    def keep(self, kept: slice) -> None:
        """Leave out joints."""
        self.names, self.q, self.v = self.names[kept], self.q[kept], self.v[kept]


Random = np.random.Generator


def _good(told: Told, random: Random) -> None:
    pass


def _nan(told: Told, random: Random) -> None:
    told.q[random.integers(told.n)] = told.v[random.integers(told.n)] = np.nan


def _infinite(told: Told, random: Random) -> None:
    told.q[random.integers(told.n)] = random.choice([-np.inf, np.inf])


def _huge(told: Told, random: Random) -> None:
    told.q *= 1e30
    told.v -= 1e30


def _jump(told: Told, random: Random) -> None:
    told.q[: told.n] += random.uniform(-3.0, 3.0, told.n)


def _fast(told: Told, random: Random) -> None:
    told.v[: told.n] = random.uniform(-30.0, 30.0, told.n)


def _old_stamp(told: Told, random: Random) -> None:
    told.stamp = max(told.stamp - random.uniform(0.0, 100.0), 0.0)


def _same_stamp(told: Told, random: Random) -> None:
    told.stamp -= told.period


def _far_stamp(told: Told, random: Random) -> None:
    told.stamp += random.uniform(1.0, 1e6)


def _short(told: Told, random: Random) -> None:
    told.q = told.q[: random.integers(len(told.q))]


def _long(told: Told, random: Random) -> None:
    told.v = np.append(told.v, 1.0)


def _empty(told: Told, random: Random) -> None:
    told.keep(slice(0))


def _other_joints(told: Told, random: Random) -> None:
    told.names[random.integers(told.n)] = "x"


def _joint_twice(told: Told, random: Random) -> None:
    told.names[random.integers(told.n)] = told.names[told.n - 1]


def _no_arm(told: Told, random: Random) -> None:
    told.keep(slice(told.n, None))


def _gripper_nan(told: Told, random: Random) -> None:
    told.near[0] = told.q[-1] = np.nan


def _gripper_short(told: Told, random: Random) -> None:
    told.near = told.near[:2]


def _no_gripper(told: Told, random: Random) -> None:
    told.keep(slice(told.n))
    told.near = told.near[:0]


# What may happen to the messages of a period; None: there are none.
FAULTS: dict[str, Callable[[Told, Random], None] | None] = {
    "silence": None,
    "NaN": _nan,
    "infinite": _infinite,
    "huge": _huge,
    "jump": _jump,
    "fast": _fast,
    "old stamp": _old_stamp,
    "same stamp": _same_stamp,
    "far stamp": _far_stamp,
    "short": _short,
    "long": _long,
    "empty": _empty,
    "other joints": _other_joints,
    "joint twice": _joint_twice,
    "no arm": _no_arm,
    "gripper NaN": _gripper_nan,
    "gripper short": _gripper_short,
    "no gripper": _no_gripper,
}


class FuzzedRobot:
    """Tells messages, good and bad, of an arm that is at once where it is sent.

    Args:
        node: That gets the messages.
        joints: Names of the arm's joints.
        fingers: Names of the gripper's joints.
    """

    def __init__(
        self, node: DirectNode, joints: Sequence[str], fingers: Sequence[str]
    ) -> None:
        self._node, self._n = node, len(joints)
        self._names, self._stamp = [*joints, *fingers], 0.0

    def tell(self, event: str, q: Vector, period: float, random: Random) -> None:
        """Deliver the messages of a control period.

        Args:
            event: One of `FAULTS`, or anything else for good messages.
            q: Where the arm is, shape (n,) [rad].
            period: [s].
            random: For the details of the fault.
        """
        self._stamp += period
        spoil = FAULTS.get(event, _good)
        if spoil is None:
            return
        size = len(self._names)
        position = np.append(q, np.zeros(size - self._n))
        told = Told(
            self._stamp,
            [*self._names],
            position,
            np.zeros(size),
            np.full(4, 0.02),
            self._n,
            period,
        )
        spoil(told, random)
        state = make_message(
            "sensor_msgs/msg/JointState",
            header=header(make_message, told.stamp),
            name=told.names,
            position=told.q,
            velocity=told.v,
            effort=np.zeros(0),
        )
        self._node.deliver("/joint_states", state)
        layout = make_message("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
        kind = "std_msgs/msg/Float64MultiArray"
        near = make_message(kind, layout=layout, data=told.near)
        self._node.deliver("/gripper/proximity", near)
