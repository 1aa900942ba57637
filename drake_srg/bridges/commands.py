"""What a bridge takes in: commands by topic, checked, the last good one kept."""

from __future__ import annotations

import dataclasses as dc
import threading
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from drake_srg.types import Vector

# Values of station input ports, by name.
PortValues = Mapping[str, Vector]


class CommandError(ValueError):
    """A command that is not taken.

    Attributes:
        kind: Of fault, as in "length"; people are warned of each kind once.
    """

    def __init__(self, kind: str, message: str):
        super().__init__(message)
        self.kind = kind


@dc.dataclass(frozen=True)
class CommandTopic:
    """A topic that commands a station.

    Attributes:
        name: ROS topic.
        type: Message type as ROS 2 writes it, as in "std_msgs/msg/Int32"; it has one
            field that matters here, `data`.
        convert: From `data` to values of the station's input ports.

    Raises:
        CommandError: By `convert`, if the command is not one to obey.
    """

    name: str
    type: str
    convert: Callable[[Any], PortValues]


class Warnings:
    """Tells people of each kind of trouble once. Any thread may call."""

    def __init__(self, tell: Callable[[str], None]):
        self._tell = tell
        self._told: set[str] = set()
        self._lock = threading.Lock()

    def warn(self, kind: str, message: str) -> None:
        """Tell `message`, unless there was one of this kind before."""
        with self._lock:
            if kind in self._told:
                return
            self._told.add(kind)
        self._tell(message)

    def forget(self, kind: str) -> None:
        """Tell of this kind again: it is over, and what comes next is news."""
        with self._lock:
            self._told.discard(kind)


class CommandInbox:
    """The commands that came since they were last taken, from any thread.

    Every command is of its topic's last message that was no fault; what several topics
    say of one port goes by the order in which they came.

    Args:
        topics: What is obeyed.
        warnings: Hears of commands that are refused.
    """

    def __init__(self, topics: Iterable[CommandTopic], warnings: Warnings):
        self.topics = {topic.name: topic for topic in topics}
        self.warnings = warnings
        self.received = 0  # messages, good and bad
        self._lock = threading.Lock()
        self._values: dict[str, Vector] = {}

    def receive(self, topic: str, data: Any) -> None:
        """Check a message's `data` and keep what it commands, or warn of it."""
        try:
            values = self.topics[topic].convert(data)
        except CommandError as error:
            self.refuse(topic, error.kind, str(error))
            return
        self.put(values)

    def put(self, values: PortValues) -> None:
        """Keep what somebody commands who has checked it."""
        with self._lock:
            self.received += 1
            self._values.update(values)

    def refuse(self, topic: str, kind: str, reason: str) -> None:
        """Count a message that is not obeyed, and warn of it."""
        with self._lock:
            self.received += 1
        self.warnings.warn(
            f"{topic} {kind}", f"{topic}: {reason}; the last good command holds"
        )

    def take(self) -> dict[str, Vector]:
        """Return what was commanded since the last time, by input port."""
        with self._lock:
            values, self._values = self._values, {}
        return values


def station_topics(
    plant: MultibodyPlant, inputs: Iterable[str], gripper_joints: Iterable[str] = ()
) -> list[CommandTopic]:
    """The SRG thesis's topics that a station can obey.

    `/grasp` (Int32, 0 open .. 100 closed), `/position_grasp` (Float64MultiArray, rad,
    one a finger joint), `/startgrasp` (Bool, false holds the gripper where it is),
    `/kuka` (Float64MultiArray, rad, one a joint of the arm). Of the first two,
    and of what the gripper's servo is told, the last counts.

    Args:
        plant: With the model instances `arm` and `gripper`, where there are such.
        inputs: Names of the station's input ports, and `arm.position_desired` for
            what /kuka asks.
        gripper_joints: Names of the gripper's commanded joints, in their order.
    """
    inputs, joints = set(inputs), list(gripper_joints)
    topics = []
    single = "gripper.joint_position_commanded"
    # What would override closure, given up.
    free = {
        port: np.full(size, np.nan)
        for port, size in (
            (single, len(joints)),
            ("gripper.motor_position_commanded", 1),
            ("gripper.motor_torque_commanded", 1),
        )
        if port in inputs
    }

    def grasp(data: Any) -> PortValues:
        percent = int(data)
        if not 0 <= percent <= 100:
            raise CommandError(
                "range", f"is {percent}; allowed are 0 (open) to 100 (closed)"
            )
        return {"gripper.closure_commanded": np.array([percent / 100.0]), **free}

    def hold(data: Any) -> PortValues:
        return {"gripper.hold": np.array([0.0 if data else 1.0])}

    if "gripper.closure_commanded" in inputs:
        topics.append(CommandTopic("/grasp", "std_msgs/msg/Int32", grasp))
    if "gripper.hold" in inputs:
        topics.append(CommandTopic("/startgrasp", "std_msgs/msg/Bool", hold))
    arrays = {}
    if joints:
        arrays["/position_grasp"] = (single, _limits(plant, "gripper", joints))
    if "arm.position_desired" in inputs:
        arrays["/kuka"] = ("arm.position_desired", _limits(plant, "arm"))
    for name, (port, limits) in arrays.items():
        topics.append(_position_topic(name, port, limits, obeyed=port in inputs))
    return topics


def _limits(
    plant: MultibodyPlant, instance: str, joints: list[str] | None = None
) -> tuple[Vector, Vector]:
    """Lower and upper position limits of a model's joints [rad or m]."""
    model = plant.GetModelInstanceByName(instance)
    if joints is None:
        found = [plant.get_joint(i) for i in plant.GetJointIndices(model)]
        moving = [joint for joint in found if joint.num_positions() == 1]
        moving.sort(key=lambda joint: joint.position_start())
    else:
        moving = [plant.GetJointByName(name, model) for name in joints]
    return (
        np.array([joint.position_lower_limit() for joint in moving]),
        np.array([joint.position_upper_limit() for joint in moving]),
    )


def _position_topic(
    name: str, port: str, limits: tuple[Vector, Vector], *, obeyed: bool
) -> CommandTopic:
    """The topic that sets the positions of a model's joints [rad or m]."""
    lower, upper = limits

    def convert(data: Any) -> PortValues:
        if not obeyed:
            raise CommandError(
                "port", "this gripper's one motor moves all joints at once"
            )
        values = np.array(data, dtype=np.float64)
        if values.shape != lower.shape:
            raise CommandError(
                "length", f"has {values.size} numbers; needs {lower.size}"
            )
        if not np.isfinite(values).all():
            raise CommandError("finite", "has numbers that are not finite")
        for i in np.flatnonzero((values < lower) | (values > upper)):
            raise CommandError(
                "range",
                f"number {i + 1} is {values[i]:g}; "
                f"allowed are {lower[i]:g} to {upper[i]:g}",
            )
        return {port: values}

    return CommandTopic(name, "std_msgs/msg/Float64MultiArray", convert)
