"""ROS 2 on the wire, by DDS and without ROS."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any

from drake_srg.common.installing import pip_install, this_package

try:
    from cyclonedds.core import DDSException
    from cyclonedds.pub import DataWriter
    from cyclonedds.qos import Policy, Qos
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic as DdsTopic
    from rosbags.typesys import Stores, get_typestore
except ImportError as error:
    raise ImportError(
        f"ROS 2 needs {error.name!r}, which is not installed. "
        f"Run: {pip_install(*this_package('ros2'))}"
    ) from error

from drake_srg.bridges.bridge import Bridge
from drake_srg.bridges.commands import CommandInbox
from drake_srg.bridges.ros2.commands import COMMAND_LIMIT, CommandReader
from drake_srg.bridges.ros2.dds_domain import domain_id, open_participant
from drake_srg.bridges.ros2.dds_types import payload_type
from drake_srg.recording.ros_topics import Topic

# rmw_qos_profile_default and rmw_qos_profile_sensor_data of ROS 2; but to wait for slow
# readers is nothing for a simulation in real time.
_DEFAULT = (
    Policy.Reliability.Reliable(max_blocking_time=0),
    Policy.History.KeepLast(10),
)
_SENSOR = (Policy.Reliability.BestEffort, Policy.History.KeepLast(5))


class Ros2Bridge(Bridge):
    """A node of ROS 2 that obeys commands and publishes topics.

    On DDS a topic is `rt/NAME`, its type is named as by ROS 2, its data is XCDR1, and
    its user data tell the type's hash, as since Iron. Topics have ROS 2's default QoS
    (reliable), the sensors' that for sensors (best effort); commands may have any.

    On the loopback interface, Fast DDS finds it as it is; Cyclone DDS does with
    ROS_LOCALHOST_ONLY=1. Images of 640 x 480 overflow the 208 KiB that Linux has for
    what a socket receives: Fast DDS may lose half of them unless it is given 4 MiB
    (`sysctl net.core.rmem_default`, or its own settings); Cyclone DDS asks for more.

    A command may have 1 MiB; larger ones are dropped. So are pictures of more than four
    bytes for each pixel that a topic of CameraInfo tells of.

    Nothing is told on `ros_discovery_info`: Humble writes it in another way than Jazzy,
    and each throws on what the other writes. So `ros2 topic` finds all topics, and
    `ros2 node list` no node. Packets that are no DDS are dropped by Cyclone DDS, which
    writes a line on each to stderr.

    Args:
        inbox: Where commands go; its topics are subscribed to.
        topics: What is published.
        domain: 0 to 232; None: the environment's ROS_DOMAIN_ID, or else 0.
        interface: IPv4 address or name of the network interface to use. Where the
            environment has a CYCLONEDDS_URI, that decides alone. Sockets are bound to
            all interfaces in any case; others are neither told of them nor answered.
        name: Of the DDS participant.

    Raises:
        ValueError: If the domain or the interface is none, or the domain is open
            already in this process.
        OSError: If Cyclone DDS does not open the domain.
    """

    def __init__(
        self,
        inbox: CommandInbox,
        topics: Sequence[Topic],
        *,
        domain: int | None = None,
        interface: str = "127.0.0.1",
        name: str = "drake_srg",
    ):
        self._store = get_typestore(Stores.ROS2_HUMBLE)
        self.domain = domain_id(domain)
        with contextlib.ExitStack() as stack:
            self._participant = stack.enter_context(
                open_participant(self.domain, interface, name, self._max_size(topics))
            )
            kinds = {topic.name: topic.type for topic in inbox.topics.values()}
            subscribed = {topic: self._topic(topic, kinds[topic]) for topic in kinds}
            self._writers = {
                topic.name: DataWriter(
                    self._participant,
                    self._topic(topic.name, topic.type),
                    self._qos(topic.type, *(_SENSOR if topic.sensor else _DEFAULT)),
                )
                for topic in topics
            }

            def make_reader(topic: str, *policies: Any) -> DataReader[Any]:
                qos = self._qos(kinds[topic], *policies)
                return DataReader(self._participant, subscribed[topic], qos)

            reader = CommandReader(self._participant, inbox, self._store, make_reader)
            stack.callback(reader.close)
            self._stack = stack.pop_all()

    @property
    def status(self) -> str:
        """The domain, for people."""
        return f"ROS 2 in domain {self.domain}"

    def has_subscribers(self, topic: str) -> bool:
        """Whether somebody listens to a topic."""
        with contextlib.suppress(DDSException):  # closed
            # Not get_matched_subscriptions: it counts, then lists, and fails if
            # somebody joins in between.
            writer: Any = self._writers[topic]  # a status's getter has no annotations
            return bool(writer.get_publication_matched_status().current_count)
        return False

    def publish(self, topic: Topic, time: float, values: Sequence[Any]) -> None:
        """Send what `topic.convert` makes of its ports' values at a time [s]."""
        message = topic.convert(self._make, time, *values)
        if message is None:
            return
        writer = self._writers[topic.name]
        sample = writer.data_type(bytes(self._store.serialize_cdr(message, topic.type)))
        # It is closed, or all that its readers have not confirmed is too much to keep;
        # then this message is lost for some.
        with contextlib.suppress(DDSException):
            writer.write(sample)

    def close(self) -> None:
        """Leave the domain; the second time, this does nothing."""
        self._stack.close()

    def _make(self, kind: str, *values: Any, **fields: Any) -> Any:
        return self._store.types[kind](*values, **fields)

    def _max_size(self, topics: Sequence[Topic]) -> int:
        """Largest message [bytes]: a command, or a picture with what is around it."""
        infos = (
            topic.convert(self._make, 0.0)
            for topic in topics
            if topic.type == "sensor_msgs/msg/CameraInfo"
        )
        pixels = max((info.height * info.width for info in infos), default=0)
        return COMMAND_LIMIT + 4 * pixels

    def _topic(self, name: str, kind: str) -> DdsTopic[Any]:
        return DdsTopic(self._participant, f"rt{name}", payload_type(self._store, kind))

    def _qos(self, kind: str, *policies: Any) -> Qos:
        return Qos(
            *policies,
            Policy.DataRepresentation(
                use_cdrv0_representation=True, use_xcdrv2_representation=False
            ),
            Policy.Userdata(f"typehash={self._store.hash_rihs01(kind)};".encode()),
        )
