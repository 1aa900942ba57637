import random
import socket
from types import SimpleNamespace

import numpy as np
import pytest
from cyclonedds.qos import Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic as DdsTopic
from pydrake.systems.sensors import CameraInfo
from rosbags.typesys import Stores, get_typestore

from drake_srg.robot.serve.commands import CommandInbox, Warnings
from drake_srg.robot.serve.pictures import camera_topics
from drake_srg.robot.serve.ros2 import bridge as ros2_bridge
from drake_srg.robot.serve.ros2.bridge import (
    COMMAND_LIMIT,
    CommandReader,
    open_participant,
    payload_type,
)
from robot.serve.ros2.peers import (
    COMMANDS,
    advertise,
    command_topics,
    free_domain,
    received,
)
from robot.serve.waiting import wait_until

pytestmark = pytest.mark.slow

CAMERA = camera_topics("ceiling", CameraInfo(640, 480, 500.0, 510.0, 320.0, 240.0))


@pytest.fixture
def topics():
    return [*CAMERA.values()]


@pytest.mark.parametrize("reliable", [True, False])
def test_each_command_of_another_process_arrives_once(
    inbox, bridge, peer, told, reliable
):
    advertise(inbox, peer, *COMMANDS, reliable=reliable)
    for i, (topic, (_, data)) in enumerate(COMMANDS.items()):
        peer.publish(topic, data)
        assert received(inbox, i + 1)
        assert inbox.take()[topic].tolist() == np.atleast_1d(data).tolist()
    assert told == []


def test_the_last_message_of_several_topics_wins(inbox, bridge, peer):
    topics = ["/kuka", "/grasp"]
    advertise(inbox, peer, *topics)
    for i in range(20):
        random.Random(i).shuffle(topics)
        for topic in topics:
            peer.publish(topic, COMMANDS[topic][1])
        assert received(inbox, 2 * i + 2)
        # The first message of a reliable writer may have to wait for a heartbeat.
        assert inbox.take()["last"] == topics[1] or i == 0


def test_no_command_is_lost_of_bursts_that_the_queues_hold(inbox, bridge, peer):
    """The bridge may be late by a burst: a busy machine does not fail this."""
    advertise(inbox, peer, *COMMANDS)
    last = {topic: data for topic, (_, data) in COMMANDS.items()}
    for burst in range(1, 6):
        peer.burst(ros2_bridge.QUEUE_DEPTH, last)
        assert received(inbox, burst * ros2_bridge.QUEUE_DEPTH * len(COMMANDS))
    taken = inbox.take()
    for topic, data in last.items():
        assert taken[topic].tolist() == np.atleast_1d(data).tolist()


def test_huge_commands_are_refused(inbox, bridge, peer, told, capfd):
    advertise(inbox, peer, "/kuka")
    good = COMMANDS["/kuka"][1]
    # The bridge refuses those up to the size of a picture, Cyclone DDS larger ones.
    for data in good, [0.0] * (COMMAND_LIMIT // 8), [0.0] * (COMMAND_LIMIT // 2):
        peer.publish("/kuka", data)
    assert received(inbox, 2)
    assert inbox.take()["/kuka"].tolist() == good
    peer.publish("/kuka", good)
    assert received(inbox, 3)
    (warning,) = told
    assert warning.startswith("/kuka: must have at most 1048576 bytes, got 10485")
    assert capfd.readouterr().err.count("dropping oversize") == 1


def test_commands_go_on_after_an_unexpected_error(
    inbox, bridge, peer, told, monkeypatch
):
    advertise(inbox, peer, "/grasp")
    receive = inbox.receive

    seen = []

    def fail(topic, data):
        seen.append(data)
        if data < 3:
            raise RuntimeError("unforeseen")
        receive(topic, data)

    monkeypatch.setattr(inbox, "receive", fail)
    for value in range(4):
        peer.publish("/grasp", value)
        assert wait_until(lambda value=value: value in seen)
    assert received(inbox, 1)
    assert inbox.take()["/grasp"] == [3.0]
    assert len(told) == 1
    assert "unforeseen" in told[0]


def test_a_command_of_a_writer_that_has_left_counts_once(told):
    store, (topic, *_) = get_typestore(Stores.ROS2_HUMBLE), command_topics()
    inbox = CommandInbox([topic], Warnings(told.append))
    message = store.types[topic.type](data=42)
    info = SimpleNamespace(valid_data=True, publication_handle=7, source_timestamp=1)
    sample = SimpleNamespace(
        sample_info=info, cdr=bytes(store.serialize_cdr(message, topic.type))
    )
    readers = []

    class Reader(DataReader):
        """Receives the sample from a writer that has left."""

        samples = (sample,)

        def take(self, N=1, condition=None, timeout=None):
            samples, self.samples = self.samples, ()
            return samples

        def get_matched_publication_data(self, handle):
            return None

    def receive(topic, content):
        inbox.receive_message(topic.name, store.deserialize_cdr(content, topic.type))

    def make_reader(name, *policies):
        dds_topic = DdsTopic(participant, f"rt{name}", payload_type(store, topic.type))
        readers.append(Reader(participant, dds_topic, Qos(*policies)))
        return readers[-1]

    with open_participant(free_domain(), "127.0.0.1", "test", 2**20) as participant:
        commands = CommandReader(participant, inbox, receive, make_reader)
        assert wait_until(lambda: not any(reader.samples for reader in readers))
        commands.close()
    assert len(readers) == 2  # reliable, best effort
    assert inbox.received == 1
    assert inbox.take()["/grasp"] == [42.0]


def test_forgotten_writers_are_looked_up_again(inbox, bridge, peer, monkeypatch):
    monkeypatch.setattr(ros2_bridge, "_MAX_WRITERS", 1)
    advertise(inbox, peer, "/grasp", "/startgrasp", reliable=True)
    advertise(inbox, peer, "/kuka", reliable=False)
    for _ in range(3):
        for topic in "/grasp", "/kuka", "/startgrasp":
            peer.publish(topic, COMMANDS[topic][1])
    assert received(inbox, 9)


def test_a_topic_with_another_type_is_reported_once(inbox, bridge, peer, told):
    peer.advertise("/grasp", "String")
    peer.advertise("/startgrasp", "Bool")
    peer.publish("/grasp", "close", "close")
    assert wait_until(lambda: told)
    assert told == [
        "/grasp: must be std_msgs/msg/Int32, but a node publishes it as "
        "std_msgs::msg::dds_::String_"
    ]
    assert inbox.received == 0


def test_noise_on_the_domain_s_ports_is_ignored(inbox, bridge, peer, told):
    generator = random.Random(0)
    first = 7400 + 250 * bridge.domain
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as noise:
        for _ in range(200):
            for header in (b"", b"RTPS\x02\x01\x01\x10"):
                data = header + generator.randbytes(generator.randrange(1, 200))
                for port in (first, first + 1, first + 10, first + 11):
                    noise.sendto(data, ("127.0.0.1", port))
    advertise(inbox, peer, "/grasp")
    peer.publish("/grasp", 3)
    assert received(inbox, 1)
    assert told == []
