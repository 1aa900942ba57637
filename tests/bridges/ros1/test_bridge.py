import contextlib
import socket
import threading

import pytest

from bridges.ros1 import peers
from bridges.ros1.peers import CLOCK
from bridges.waiting import wait_until
from drake_srg.bridges.commands import CommandInbox, CommandTopic, Warnings
from drake_srg.bridges.ros1.bridge import Ros1Bridge
from drake_srg.bridges.ros2.follow_joint_trajectory import (
    STATUS,
    FollowJointTrajectory,
)
from drake_srg.recording.ros_topics import Topic


def test_the_first_status_knows_whether_the_master_answers(new_bridge, master):
    assert new_bridge(master=master.uri).status == f"ROS 1 at {master.uri}"


@pytest.mark.slow
def test_close_does_not_wait_for_a_hanging_master(new_bridge):
    with socket.create_server(("127.0.0.1", 0)) as hanging:
        port = hanging.getsockname()[1]
        new_bridge(master=f"http://127.0.0.1:{port}").close()
        assert not [t for t in threading.enumerate() if t.name == "ros1"]


def test_the_environment_has_the_default_master(new_bridge, monkeypatch):
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:9")
    assert new_bridge([]).status.startswith("ROS 1 at http://127.0.0.1:9")
    monkeypatch.delenv("ROS_MASTER_URI")
    assert new_bridge([]).status.startswith("ROS 1 at http://localhost:11311")


def test_after_a_request_to_shut_down_publishing_does_nothing(bridge, master, told):
    connection, _ = peers.subscribe(master.node, "/clock", md5sum="*")
    assert not bridge.closed
    assert master.node.shutdown("/rosnode", "user request")[0] == 1
    assert wait_until(lambda: bridge.closed)
    assert bridge.status == "ROS 1 shut down"
    assert wait_until(lambda: master.registered == {})
    with pytest.raises(ConnectionError):
        peers.receive(connection, 1)
    bridge.publish(CLOCK, 1.0, [])
    assert not bridge.has_subscribers("/clock")
    assert len(told.about("user request")) == 1


def test_services_of_ros_2_are_left_to_ros_2(told):
    service = FollowJointTrajectory("/arm/follow").cancel_goal
    inbox = CommandInbox(
        [CommandTopic(service.request, service.request_type, dict)],
        Warnings(told.append),
    )
    reply = Topic(service.reply, service.reply_type, {}, dict)
    status = Topic("/arm/status", STATUS, {}, dict)
    master = "http://127.0.0.1:9"
    with contextlib.closing(
        Ros1Bridge(inbox, [reply, status], master=master)
    ) as bridge:
        assert not bridge.has_subscribers(reply.name)
