"""The bridge to ROS 2."""

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
from drake_srg.bridges.commands import COMMAND_LIMIT, CommandInbox
from drake_srg.bridges.ros2.commands import CommandReader
from drake_srg.bridges.ros2.dds_domain import domain_id, open_participant
from drake_srg.bridges.ros2.dds_types import payload_type, topic_name
from drake_srg.bridges.ros2.follow_joint_trajectory import with_actions
from drake_srg.recording.ros_topics import MakeMessage, Topic

# ROS 2's rmw_qos_profile_default and rmw_qos_profile_sensor_data, except that a
# simulation in real time never waits for slow readers.
_DEFAULT = (
    Policy.Reliability.Reliable(max_blocking_time=0),
    Policy.History.KeepLast(10),
)
_SENSOR = (Policy.Reliability.BestEffort, Policy.History.KeepLast(5))
# Of an action's status (rcl_action_qos_profile_status_default).
_LATCHED = (
    Policy.Reliability.Reliable(max_blocking_time=0),
    Policy.Durability.TransientLocal,
    Policy.History.KeepLast(1),
)


class Ros2Bridge(Bridge):
    """A ROS 2 node that obeys commands and publishes topics.

    On DDS, a topic is `rt/NAME` with ROS 2's type name, XCDR1 data, and the type's hash
    in its user data, as since Iron. A topic whose name begins without a slash, such as
    a service's, has that name on DDS. Topics have ROS 2's default QoS (reliable),
    camera topics that for sensors (best effort). Commands may have either.

    On the loopback interface, Fast DDS finds the node with default settings, Cyclone
    DDS with ROS_LOCALHOST_ONLY=1. Images of 640 x 480 exceed Linux's default receive
    buffer of 208 KiB: Fast DDS may lose half of them unless it gets 4 MiB (`sysctl
    net.core.rmem_default`, or its own settings). Cyclone DDS asks for a larger buffer.

    Commands may have up to their topic's `largest` size, pictures up to four bytes for
    each pixel of the largest CameraInfo. Larger messages are dropped.

    The node does not publish `ros_discovery_info`, because Humble and Jazzy encode it
    differently and each throws on the other's. So `ros2 topic` finds all topics, but
    `ros2 node list` does not show the node. Cyclone DDS drops packets that are not DDS
    and writes a line on each to stderr.

    Args:
        inbox: Where commands go; its topics are subscribed to.
        topics: The topics to publish.
        domain: 0 to 232; None takes ROS_DOMAIN_ID from the environment, or 0.
        interface: IPv4 address or name of the network interface to use. A
            CYCLONEDDS_URI in the environment replaces it. Sockets are bound to all
            interfaces in any case, but only this one is announced and answered.
        name: Name of the DDS participant.

    Attributes:
        domain: The domain's number.

    Raises:
        ValueError: If the domain or the interface is invalid, or the domain is already
            open in this process.
        OSError: If Cyclone DDS cannot open the domain.
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
        self._store = with_actions(get_typestore(Stores.ROS2_HUMBLE))
        self.domain = domain_id(domain)
        received = [topic.largest for topic in inbox.topics.values()]
        limit = max([largest_message(topics, self._make), *received])
        with contextlib.ExitStack() as stack:
            self._participant = stack.enter_context(
                open_participant(self.domain, interface, name, limit)
            )
            types = {topic.name: topic.type for topic in inbox.topics.values()}
            subscribed = {topic: self._topic(topic, types[topic]) for topic in types}
            self._writers = {
                topic.name: DataWriter(
                    self._participant,
                    self._topic(topic.name, topic.type),
                    self._qos(topic.name, topic.type, _policies(topic), writes=True),
                )
                for topic in topics
            }

            def make_reader(topic: str, *policies: Any) -> DataReader[Any]:
                qos = self._qos(topic, types[topic], policies, writes=False)
                return DataReader(self._participant, subscribed[topic], qos)

            reader = CommandReader(self._participant, inbox, self._store, make_reader)
            stack.callback(reader.close)
            self._stack = stack.pop_all()

    @property
    def status(self) -> str:
        """The domain, as text for the status line."""
        return f"ROS 2 in domain {self.domain}"

    def has_subscribers(self, topic: str) -> bool:
        """Return whether a topic has a subscriber."""
        with contextlib.suppress(DDSException):  # closed
            # Not get_matched_subscriptions: it counts, then lists, and fails if a
            # reader joins in between.
            writer: Any = self._writers[topic]  # the status getter is not annotated
            return bool(writer.get_publication_matched_status().current_count)
        return False

    def publish(self, topic: Topic, time: float, values: Sequence[Any]) -> None:
        """Send the message that `topic.convert` makes of values at a time [s]."""
        message = topic.convert(self._make, time, *values)
        if message is None:
            return
        writer = self._writers[topic.name]
        sample = writer.data_type(bytes(self._store.serialize_cdr(message, topic.type)))
        # Raised if the bridge is closed, or if its readers have too many unconfirmed
        # messages; then some readers lose this one.
        with contextlib.suppress(DDSException):
            writer.write(sample)

    def close(self) -> None:
        """Leave the domain. A second call does nothing."""
        self._stack.close()

    def _make(self, type: str, *values: Any, **fields: Any) -> Any:
        return self._store.types[type](*values, **fields)

    def _topic(self, name: str, type: str) -> DdsTopic[Any]:
        return DdsTopic(
            self._participant, topic_name(name), payload_type(self._store, type)
        )

    def _qos(
        self, name: str, type: str, policies: Sequence[Any], *, writes: bool
    ) -> Qos:
        user_data = []
        if not name.startswith("/"):
            # rmw_cyclonedds_cpp finds by it which reader and writer belong together.
            role = "clientid" if name.startswith("rq") == writes else "serviceid"
            user_data = [f"{role}={self._participant.guid.hex};"]
        elif "/msg/" in type:
            user_data = [f"typehash={self._store.hash_rihs01(type)};"]
        return Qos(
            *policies,
            Policy.DataRepresentation(
                use_cdrv0_representation=True, use_xcdrv2_representation=False
            ),
            *(Policy.Userdata(text.encode()) for text in user_data),
        )


def _policies(topic: Topic) -> tuple[Any, ...]:
    if topic.latched:
        return _LATCHED
    return _SENSOR if topic.sensor else _DEFAULT


def largest_message(topics: Sequence[Topic], make: MakeMessage) -> int:
    """Return the size limit of a domain [bytes]: room for a picture and a command.

    Args:
        topics: The topics to publish; their CameraInfo tells how large pictures are.
        make: Makes a message, as for `Topic.convert`.
    """
    infos = (
        topic.convert(make, 0.0)
        for topic in topics
        if topic.type == "sensor_msgs/msg/CameraInfo"
    )
    pixels = max((info.height * info.width for info in infos), default=0)
    return COMMAND_LIMIT + 4 * pixels
