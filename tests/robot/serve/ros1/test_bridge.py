import contextlib
import socket
import threading
import time
import xmlrpc.client
from urllib.parse import urlsplit

import pytest

from drake_srg.recording.rosbag import Topic
from drake_srg.robot.serve.action_server import STATUS, FollowJointTrajectory
from drake_srg.robot.serve.commands import CommandInbox, CommandTopic, Warnings
from drake_srg.robot.serve.ros1 import bridge as ros1_bridge
from drake_srg.robot.serve.ros1.bridge import Ros1Bridge
from robot.serve.ros1 import peers
from robot.serve.ros1.peers import CLOCK, INT32, free_port, int32, taken
from robot.serve.waiting import wait_until


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


def test_all_topics_are_registered_and_unregistered(bridge, master):
    assert {key: entry[:2] for key, entry in master.registered.items()} == {
        ("Publisher", "/clock"): ("/drake_srg", "rosgraph_msgs/Clock"),
        ("Publisher", "/joint_states"): ("/drake_srg", "sensor_msgs/JointState"),
        ("Publisher", "/image"): ("/drake_srg", "sensor_msgs/Image"),
        ("Subscriber", "/grasp"): ("/drake_srg", "std_msgs/Int32"),
        ("Subscriber", "/startgrasp"): ("/drake_srg", "std_msgs/Bool"),
        ("Subscriber", "/kuka"): ("/drake_srg", "std_msgs/Float64MultiArray"),
    }
    bridge.close()
    assert master.registered == {}
    assert not [t for t in threading.enumerate() if t.name == "ros1"]
    bridge.close()


@pytest.mark.slow
def test_it_waits_for_a_master_that_starts_later(new_bridge, told):
    port = free_port()
    uri = f"http://127.0.0.1:{port}"
    bridge = new_bridge(master=uri)
    assert wait_until(lambda: told)
    time.sleep(0.2)
    assert bridge.status == f"ROS 1 at {uri} (waiting for roscore)"
    with contextlib.closing(peers.Master(port)) as master:
        assert wait_until(lambda: bridge.status == f"ROS 1 at {uri}")
        assert len(master.registered) == 6
    assert wait_until(lambda: len(told) == 2)
    assert "waiting" in bridge.status
    with contextlib.closing(peers.Master(port)) as master:
        assert wait_until(lambda: len(master.registered) == 6)
        assert wait_until(lambda: "waiting" not in bridge.status)
    assert wait_until(lambda: len(told) == 3)
    assert "waiting" in bridge.status
    time.sleep(0.2)
    bridge.close()
    assert len(told) == 3  # one warning per outage
    assert all("waiting for it" in text for text in told)


def test_a_connection_survives_a_restart_of_the_master(
    bridge, inbox, master, publisher
):
    master.tell("/grasp", publisher.uri)
    connection = publisher.accept(**INT32)
    master.registered.clear()  # like a master that has restarted
    assert wait_until(lambda: len(master.registered) == 6)
    connection.sendall(int32(7))
    assert taken(inbox, "closure") == [0.07]


def test_an_update_of_the_master_overrides_its_older_answer(
    new_bridge, inbox, publisher
):
    class Busy(peers.Master):
        def _register(self, role, node, topic, type, uri):
            answer = super()._register(role, node, topic, type, uri)
            if topic == "/grasp":
                self.tell(topic, publisher.uri)  # before the answer is sent
            return answer

    with contextlib.closing(Busy()) as master:
        bridge = new_bridge(master=master.uri)
        publisher.accept(**INT32).sendall(int32(7))
        assert taken(inbox, "closure") == [0.07]
        bridge.close()


@pytest.mark.parametrize(
    "uri", ["localhost:11311", "http://", "http://host", "http://h:x", "https://h:1"]
)
def test_an_invalid_master_is_refused(new_bridge, uri):
    with pytest.raises(ValueError, match=f"must be http://HOST:PORT.*got '{uri}'"):
        new_bridge(master=uri)


def test_a_node_that_cannot_start_leaves_nothing_behind(new_bridge, monkeypatch):
    listeners = []

    async def fail(listener, *_):
        listeners.append(listener)
        raise OSError("no")

    monkeypatch.setattr(ros1_bridge, "serve", fail)
    with pytest.raises(OSError, match="no"):
        new_bridge(master="http://127.0.0.1:9")
    assert listeners[0].fileno() == -1
    assert not [t for t in threading.enumerate() if t.name == "ros1"]


def test_hanging_lookups_of_publishers_delay_nobody(
    new_bridge, inbox, master, publisher, hanging_names, told
):
    bridge = new_bridge(master=master.uri.replace("127.0.0.1", "localhost"))
    robots = [f"http://robot{i}:1234/" for i in range(40)]
    master.tell("/grasp", *robots, publisher.uri)
    publisher.accept(**INT32).sendall(int32(7))
    assert taken(inbox, "closure") == [0.07]
    master.registered.clear()  # like a master that has restarted
    assert wait_until(lambda: len(master.registered) == 6)
    bridge.close()
    assert not [t for t in threading.enumerate() if t.name == "ros1"]
    assert hanging_names.pending  # nobody waited for them
    assert not told.about("roscore")


def test_a_node_answers_questions_about_itself(bridge, inbox, master, publisher):
    master.tell("/grasp", publisher.uri)
    publisher.accept(**INT32).sendall(int32(1))
    taken(inbox, "closure")
    connection, _ = peers.subscribe(master.node, "/clock", md5sum="*")
    bridge.publish(CLOCK, 1.0, [])
    peers.receive_frame(connection)
    node = master.node
    assert node.getMasterUri("/x") == [1, "", master.uri]
    assert ["/kuka", "std_msgs/Float64MultiArray"] in node.getSubscriptions("/x")[2]
    assert ["/clock", "rosgraph_msgs/Clock"] in node.getPublications("/x")[2]
    assert node.paramUpdate("/x", "/use_sim_time", True)[0] == 1
    info = {topic: row for row in node.getBusInfo("/x")[2] for topic in [row[4]]}
    assert info["/clock"][1:4] == ["/peer", "o", "TCPROS"]
    assert info["/grasp"][1:4] == [publisher.uri, "i", "TCPROS"]
    assert node.requestTopic("/x", "/clock", [["UDPROS"]])[0] == 0
    assert node.requestTopic("/x", "/nothing", [["TCPROS"]])[0] == -1
    assert node.publisherUpdate("/x", "/nothing", [])[0] == -1


@pytest.mark.parametrize("method", ["noSuchMethod", "_shutdown", "answer", "getPid"])
def test_an_invalid_call_is_answered_with_a_fault(bridge, master, method):
    with pytest.raises(xmlrpc.client.Fault):
        getattr(master.node, method)()  # getPid lacks the caller's name


@pytest.mark.parametrize(
    "garbage",
    [
        b"\0" * 100 + b"\r\n\r\n",
        b"POST / HTTP/1.0\r\nContent-Length: 999999999\r\n\r\n",
        b"POST / HTTP/1.0\r\nContent-Length: 3\r\n\r\n<<<",
        b"x" * 200_000,
        b"POST / HTTP/1.0\r\nContent-Le",
    ],
)
def test_garbage_instead_of_a_request_is_refused_with_one_warning(
    bridge, master, told, garbage
):
    uri = urlsplit(master.node_uri)
    for _ in range(2):
        with (
            contextlib.suppress(OSError),  # possibly closed before all is sent
            socket.create_connection((uri.hostname, uri.port), timeout=20.0) as peer,
        ):
            peer.sendall(garbage)
            peer.shutdown(socket.SHUT_WR)
            assert peer.recv(1) == b""
    assert len(told.about("refused a request")) == 1
    assert master.node.getPid("/x")[0] == 1
