"""Rosbags: ROS topics made from the values of ports, and their recorder.

A recorder's ports are named like those of a station or cell, so a loop can connect
them. The functions here return a `Topic`; write your own in the same way.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageRgba8U

from drake_srg.common.safety_states import describe_safety
from drake_srg.lifetime import weak
from drake_srg.recording.output import Recorder, require
from drake_srg.types import PlannerStatus, mode_name

# Makes a message: (type name such as "std_msgs/msg/String", fields) -> message. Fields
# are given by name or, where ROS 1 and 2 name them differently, in order.
MakeMessage = Callable[..., Any]
# (make, time [s], one value per port, None for an unconnected optional port) -> message
Convert = Callable[..., Any]
OBJECT_POSE = "/planner/object_pose"


@dc.dataclass(frozen=True)
class Topic:
    """A ROS topic whose messages are made from port values.

    Attributes:
        name: Its name, with the leading slash.
        type: Its ROS 2 message type, such as "std_msgs/msg/String".
        ports: Input port name to its model value, or to its size if it is a vector.
            Topics may share a port.
        convert: Called as `convert(make, time, *values)`; returns a message, or None
            for no message.
        period: Time between messages [s]; None: the recorder's period.
        optional: The ports that may stay unconnected.
        sensor: Whether ROS 2 publishes it with the QoS for sensor data, which does not
            resend lost messages.
        latched: Whether ROS 2 keeps the last message for later subscribers.
    """

    name: str
    type: str
    ports: Mapping[str, int | AbstractValue]
    convert: Convert
    period: float | None = None
    optional: frozenset[str] = frozenset()
    sensor: bool = False
    latched: bool = False


def stamp(make: MakeMessage, time: float) -> Any:
    """Return simulated time [s] as a builtin_interfaces/msg/Time."""
    sec, nanosec = divmod(round(time * 1e9), 10**9)
    return make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)


def header(make: MakeMessage, time: float, frame_id: str = "") -> Any:
    """Return a std_msgs/msg/Header."""
    return make("std_msgs/msg/Header", stamp=stamp(make, time), frame_id=frame_id)


def clock() -> Topic:
    """Return /clock: simulated time as rosgraph_msgs/msg/Clock."""
    kind = "rosgraph_msgs/msg/Clock"
    return Topic("/clock", kind, {}, lambda make, t: make(kind, clock=stamp(make, t)))


def float64(name: str, port: str, model: int | AbstractValue = 1) -> Topic:
    """Return a topic of a number, as std_msgs/msg/Float64.

    Args:
        name: Name of the topic.
        port: Name of the input port.
        model: Model value of the port; 1: a vector of size 1.
    """
    kind = "std_msgs/msg/Float64"

    def convert(make: MakeMessage, time: float, value: Any) -> Any:
        return make(kind, data=float(np.reshape(value, ())))

    return Topic(name, kind, {port: model}, convert)


def float64_array(name: str, port: str, size: int) -> Topic:
    """Return a topic of a vector port, as std_msgs/msg/Float64MultiArray."""
    kind = "std_msgs/msg/Float64MultiArray"

    def convert(make: MakeMessage, time: float, value: Any) -> Any:
        layout = make("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
        return make(kind, layout=layout, data=np.array(value, dtype=np.float64))

    return Topic(name, kind, {port: size}, convert)


def string(
    name: str,
    port: str,
    model: int | AbstractValue | None = None,
    words: Callable[[Any], str] = mode_name,
) -> Topic:
    """Return a topic of a string, or of the name of a mode, as std_msgs/msg/String.

    Args:
        name: Name of the topic.
        port: Name of the input port.
        model: Model value of the port; None: a Python object, such as an enum.
        words: Returns the text for a value.
    """
    kind = "std_msgs/msg/String"

    def convert(make: MakeMessage, time: float, value: Any) -> Any:
        return make(kind, data=words(value))

    return Topic(name, kind, {port: model or AbstractValue.Make(object())}, convert)


def _safety_topics(safety: str) -> tuple[Topic, Topic]:
    """Return the topics of a safety monitor: its state as text, and the speed scale.

    `safety` is the prefix of its ports. States are, for example, "running" and
    "protective_stop: stale".
    """
    topic = topic_of(safety)
    return (
        string(f"{topic}/state", f"{safety}.state", 2, describe_safety),
        float64(f"{topic}/speed_scale", f"{safety}.speed_scale"),
    )


def pose_message(make: MakeMessage, time: float, X_WO: RigidTransform) -> Any:
    """Return a pose in world at a time [s] as a geometry_msgs/msg/PoseStamped."""
    x, y, z = X_WO.translation()
    turn = X_WO.rotation().ToQuaternion()
    return make(
        "geometry_msgs/msg/PoseStamped",
        header=header(make, time, "world"),
        pose=make(
            "geometry_msgs/msg/Pose",
            position=make("geometry_msgs/msg/Point", x=x, y=y, z=z),
            orientation=make(
                "geometry_msgs/msg/Quaternion",
                **{name: float(getattr(turn, name)()) for name in "xyzw"},
            ),
        ),
    )


def object_pose(name: str, port: str) -> Topic:
    """Return a topic of the planner's last sighting of its object.

    The message is a geometry_msgs/msg/PoseStamped with the time of the look. There is
    none before the planner has seen the object. The port's values are `PlannerStatus`.
    """

    def convert(make: MakeMessage, time: float, status: PlannerStatus) -> Any:
        blob = status.sighting
        return blob and pose_message(make, status.sighted_at, blob.X_WO)

    model = AbstractValue.Make(PlannerStatus())
    return Topic(name, "geometry_msgs/msg/PoseStamped", {port: model}, convert)


def image(name: str, port: str, frame_id: str, period: float) -> Topic:
    """Return a topic of an ImageRgba8U port, as sensor_msgs/msg/Image in rgb8.

    `period` is the time between messages [s].
    """

    def convert(make: MakeMessage, time: float, value: ImageRgba8U) -> Any:
        rgb = cv2.cvtColor(value.data, cv2.COLOR_RGBA2RGB)  # faster than slicing
        return image_message(make, time, frame_id, "rgb8", rgb)

    model = AbstractValue.Make(ImageRgba8U())
    return Topic(name, "sensor_msgs/msg/Image", {port: model}, convert, period)


def image_message(
    make: MakeMessage, time: float, frame_id: str, encoding: str, pixels: Any
) -> Any:
    """Return pixels, shape (height, width, channels), as a sensor_msgs/msg/Image."""
    pixels = np.ascontiguousarray(pixels)
    height, width = pixels.shape[:2]
    return make(
        "sensor_msgs/msg/Image",
        header=header(make, time, frame_id),
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=pixels.nbytes // height,
        data=pixels.reshape(-1).view(np.uint8),
    )


def joint_states(joints: Mapping[str, Sequence[str]]) -> Topic:
    """Return /joint_states: all instances' joints in one sensor_msgs/msg/JointState.

    Args:
        joints: Instance name to its joint names. Instance I has the ports
            `I.state_measured` ([q; v], rad and rad/s) and, optionally,
            `I.torque_measured` (N m); efforts that are not measured are NaN.
    """
    kind = "sensor_msgs/msg/JointState"
    names = [name for group in joints.values() for name in group]
    ports: dict[str, int | AbstractValue] = {}
    for instance, group in joints.items():
        ports[f"{instance}.state_measured"] = 2 * len(group)
        ports[f"{instance}.torque_measured"] = len(group)

    def convert(make: MakeMessage, time: float, *values: Any) -> Any:
        states = [np.split(np.asarray(state), 2) for state in values[::2]]
        efforts = [
            np.full(len(q), np.nan) if torque is None else torque
            for (q, _), torque in zip(states, values[1::2], strict=True)
        ]
        return make(
            kind,
            header=header(make, time),
            name=names,
            position=np.concatenate([q for q, _ in states]),
            velocity=np.concatenate([v for _, v in states]),
            effort=np.concatenate(efforts),
        )

    optional = frozenset(f"{instance}.torque_measured" for instance in joints)
    return Topic("/joint_states", kind, ports, convert, optional=optional)


@dc.dataclass(frozen=True)
class ArmNames:
    """The names of an arm with its gripper, for its topics.

    Attributes:
        arm_joints: Names of the arm's joints; empty without an arm.
        gripper_joints: Names of the gripper's actuated joints; empty without a gripper.
        sensors: Number of finger sensors.
        arm: Prefix of the arm's ports.
        gripper: Prefix of the gripper's ports.
        safety: Prefix of the safety monitor's ports; empty without one.
        felt: Whether the station estimates the arm's external torques.
    """

    arm_joints: Sequence[str] = ()
    gripper_joints: Sequence[str] = ()
    sensors: int = 0
    arm: str = "arm"
    gripper: str = "gripper"
    safety: str = ""
    felt: bool = False

    def topics(self) -> list[Topic]:
        """Return the topics of commands and of the finger sensors."""
        arm, gripper, size = self.arm, self.gripper, len(self.arm_joints)
        return [
            _array(arm, "position_commanded", size),
            float64(
                f"{topic_of(gripper)}/closure_commanded", f"{gripper}.closure_commanded"
            ),
            _array(gripper, "proximity", self.sensors),
            _array(gripper, "contact_force", self.sensors),
        ]

    def monitored(self) -> list[Topic]:
        """Return the topics of the safety monitor and of external torques."""
        torque = _array(self.arm, "external_torque", len(self.arm_joints))
        return [
            *(_safety_topics(self.safety) if self.safety else ()),
            *([torque] if self.felt else []),
        ]


def finger_topics(gripper: str, links: Mapping[str, str]) -> list[Topic]:
    """Return the topics of a grasp, and of the contact wrench on each link.

    Args:
        gripper: Prefix of the gripper's ports, and the name of its model.
        links: Links by the names of their sensors. A wrench is about the link's origin,
            in the link's frame.
    """
    kind, port = "geometry_msgs/msg/WrenchStamped", f"{gripper}.contact_wrench"

    def convert(
        index: int, link: str, make: MakeMessage, time: float, value: Any
    ) -> Any:
        torque, force = (
            make("geometry_msgs/msg/Vector3", **dict(zip("xyz", xyz, strict=True)))
            for xyz in np.reshape(value, (-1, 2, 3))[index].tolist()
        )
        frame = f"{gripper}/{link}"  # as in /tf
        wrench = make("geometry_msgs/msg/Wrench", force=force, torque=torque)
        return make(kind, header=header(make, time, frame), wrench=wrench)

    def grasped(make: MakeMessage, time: float, value: Any) -> Any:
        return make("std_msgs/msg/Bool", data=bool(value[0]))

    root, size = topic_of(gripper), 6 * len(links)
    return [
        Topic(
            f"{root}/grasped", "std_msgs/msg/Bool", {f"{gripper}.grasped": 1}, grasped
        ),
        *(
            Topic(
                f"{root}/contact_wrench/{sensor}",
                kind,
                {port: size},
                partial(convert, i, link),
            )
            for i, (sensor, link) in enumerate(links.items())
        ),
    ]


def topic_of(ports: str) -> str:
    """Return the topic for a prefix of ports: /left/gripper for `left.gripper`."""
    return "/" + ports.replace(".", "/")


def _array(ports: str, name: str, size: int) -> Topic:
    return float64_array(f"{topic_of(ports)}/{name}", f"{ports}.{name}", size)


def cell_topics(
    arms: Sequence[ArmNames],
    cameras: Mapping[str, float] | None = None,
    *,
    located: bool = False,
) -> list[Topic]:
    """Return the topics of a cell.

    Args:
        arms: Names of its arms.
        cameras: Camera name to the time between its images [s].
        located: Whether the planner locates one object to pick.
    """
    joints = {
        instance: names
        for arm in arms
        for instance, names in (
            (arm.arm, arm.arm_joints),
            (arm.gripper, arm.gripper_joints),
        )
        if names
    }
    return [
        clock(),
        *([joint_states(joints)] if joints else []),
        *(topic for arm in arms for topic in arm.topics()),
        string("/planner/mode", "planner.mode"),
        *(topic for arm in arms for topic in arm.monitored()),
        *([object_pose(OBJECT_POSE, "planner.status")] if located else []),
        *(
            image(
                f"/camera_{name}/color/image_raw",
                f"camera_{name}.color_image",
                f"camera_{name}",
                period,
            )
            for name, period in (cameras or {}).items()
        ),
    ]


class RosbagRecorder(Recorder):
    """Writes topics into one rosbag2 file in MCAP format.

    .. pydrake_system::

        name: RosbagRecorder
        input_ports:
        - (the ports of all topics)

    A topic is recorded at every multiple of its period except 0, stamped with simulated
    time. The file contains the definitions of its messages, so
    `rosbags.rosbag2.Reader`, `ros2 bag info` and Foxglove need no other file. The file
    appears under its name on `close()`. Use the recorder as a context manager around
    the simulation, so that it is closed even after an error.

    Args:
        path: The .mcap file.
        topics: The topics; see `drake_srg.recording.rosbag`.
        period: Time between messages of topics without a period of their own [s].

    Raises:
        OSError: If the file cannot be written.
        ValueError: If there are no topics, one appears twice, a period is not positive,
            the file is not named .mcap, or two topics disagree on the type of a port.
    """

    def __init__(
        self, path: Path | str, topics: Sequence[Topic], *, period: float = 0.02
    ):
        super().__init__()
        path = Path(path)
        names = [topic.name for topic in topics]
        if not names or len(set(names)) < len(names):
            raise ValueError(
                f"RosbagRecorder: topics must have unique names, got {names}"
            )
        if path.suffix != ".mcap":
            raise ValueError(
                f"RosbagRecorder: path must end in .mcap, got {path.name!r}"
            )
        for topic in topics:
            every = period if topic.period is None else topic.period
            if every <= 0:
                raise ValueError(
                    f"{topic.name}: period must be greater than 0, got {every}"
                )

        rosbag2, typesys = require("rosbags.rosbag2"), require("rosbags.typesys")
        self._store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        self._begin(path)
        # The writer makes a folder NAME with the file NAME.mcap in it.
        self._bag = self._output.path.with_suffix("")
        self._writer = rosbag2.Writer(
            self._bag, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP
        )
        self._writer.set_compression(
            rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD
        )
        self._writer.open()
        self._messages = 0

        record = weak(self._record)  # a closure over self would keep the recorder alive
        sizes: dict[str, object] = {}
        for topic in topics:
            self._declare_ports(topic, sizes)
            # Compile the type's serializer now: it takes up to 50 ms, which would delay
            # a loop in real time.
            self._store.get_msgdef(topic.type)
            connection = self._writer.add_connection(
                topic.name, topic.type, typestore=self._store
            )
            every = period if topic.period is None else topic.period
            self.DeclarePeriodicPublishEvent(
                every,
                every,
                lambda context, t=topic, c=connection: record(context, t, c),
            )

    def _finish(self) -> bool:
        try:
            self._writer.close()
        except OSError as error:  # such as a full disk
            raise OSError(error.errno, error.strerror, str(self.path)) from error
        (self._bag / self._output.path.name).replace(self._output.path)
        # After a failure, an empty bag is not worth keeping.
        return self._messages > 0 or not self._failed

    def _declare_ports(self, topic: Topic, declared: dict[str, object]) -> None:
        for port, model in topic.ports.items():
            kind = model if isinstance(model, int) else type(model)
            if declared.setdefault(port, kind) != kind:
                raise ValueError(
                    f"{topic.name}: port {port!r} is {kind} here and "
                    f"{declared[port]} in another topic"
                )
            if self.HasInputPort(port):
                continue
            if isinstance(model, int):
                self.DeclareVectorInputPort(name=port, size=model)
            else:
                self.DeclareAbstractInputPort(name=port, model_value=model)

    def _record(self, context: Context, topic: Topic, connection: Any) -> None:
        if self._closed:
            raise RuntimeError(f"{self.path}: the recorder is closed; make a new one")
        values = []
        for name in topic.ports:
            port = self.GetInputPort(name)
            if port.HasValue(context):
                values.append(port.Eval(context))
            elif name in topic.optional:
                values.append(None)
            else:
                raise RuntimeError(
                    f"RosbagRecorder: input port {name!r} ({topic.name}) is not "
                    "connected"
                )
        message = topic.convert(self._make, context.get_time(), *values)
        if message is not None:
            self._writer.write(
                connection,
                round(context.get_time() * 1e9),
                self._store.serialize_cdr(message, topic.type),
            )
            self._messages += 1

    def _make(self, kind: str, *values: Any, **fields: Any) -> Any:
        return self._store.types[kind](*values, **fields)
