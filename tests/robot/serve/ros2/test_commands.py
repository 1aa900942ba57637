import random

import numpy as np
import pytest
from pydrake.systems.sensors import CameraInfo

from drake_srg.robot.serve.pictures import camera_topics
from drake_srg.robot.serve.ros2 import bridge as ros2_bridge
from drake_srg.robot.serve.ros2.bridge import (
    COMMAND_LIMIT,
)
from robot.serve.ros2.peers import (
    COMMANDS,
    advertise,
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
