import contextlib
import socket
import threading
import time

import pytest

from bridges.ros1 import ros1_peers as peers
from bridges.ros1.ros1_peers import (
    CLOCK,
    INT32,
    TOPICS,
    free_port,
    int32,
    taken,
    wait_until,
)
from drake_srg.bridges.ros1 import node as ros1_node
from drake_srg.bridges.ros1.bridge import Ros1Bridge


def test_everything_is_registered_and_unregistered(ros1_bridge, ros1_master):
    assert {key: entry[:2] for key, entry in ros1_master.registered.items()} == {
        ("Publisher", "/clock"): ("/drake_srg", "rosgraph_msgs/Clock"),
        ("Publisher", "/joint_states"): ("/drake_srg", "sensor_msgs/JointState"),
        ("Publisher", "/image"): ("/drake_srg", "sensor_msgs/Image"),
        ("Subscriber", "/grasp"): ("/drake_srg", "std_msgs/Int32"),
        ("Subscriber", "/startgrasp"): ("/drake_srg", "std_msgs/Bool"),
        ("Subscriber", "/kuka"): ("/drake_srg", "std_msgs/Float64MultiArray"),
    }
    ros1_bridge.close()
    assert ros1_master.registered == {}
    assert not [t for t in threading.enumerate() if t.name == "ros1"]
    ros1_bridge.close()


def test_a_master_that_comes_later_is_waited_for(inbox, told, impatient):
    port = free_port()
    uri = f"http://127.0.0.1:{port}"
    with contextlib.closing(Ros1Bridge(inbox, TOPICS, master=uri)) as bridge:
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
    assert len(told) == 3  # once each time that it was gone
    assert all("waiting for it" in text for text in told)


def test_the_first_status_knows_the_master(inbox, ros1_master):
    bridge = Ros1Bridge(inbox, TOPICS, master=ros1_master.uri)
    with contextlib.closing(bridge):
        assert bridge.status == f"ROS 1 at {ros1_master.uri}"


def test_a_publisher_survives_its_master(
    ros1_bridge, inbox, ros1_master, ros1_publisher
):
    ros1_master.tell("/grasp", ros1_publisher.uri)
    connection = ros1_publisher.accept(**INT32)
    ros1_master.registered.clear()  # as if there were a new one
    assert wait_until(lambda: len(ros1_master.registered) == 6)
    connection.sendall(int32(7))
    assert taken(inbox, "closure") == [0.07]


def test_the_news_of_a_master_count_more_than_its_older_answer(
    inbox, ros1_publisher, impatient
):
    class Busy(peers.Master):
        def _register(self, role, node, topic, type, uri):
            answer = super()._register(role, node, topic, type, uri)
            if topic == "/grasp":
                self.tell(topic, ros1_publisher.uri)  # before the answer is sent
            return answer

    with contextlib.closing(Busy()) as master:
        bridge = Ros1Bridge(inbox, TOPICS, master=master.uri)
        with contextlib.closing(bridge):
            ros1_publisher.accept(**INT32).sendall(int32(7))
            assert taken(inbox, "closure") == [0.07]


def test_close_does_not_wait_for_a_master_that_hangs(inbox):
    with socket.create_server(("127.0.0.1", 0)) as hanging:
        port = hanging.getsockname()[1]
        bridge = Ros1Bridge(inbox, TOPICS, master=f"http://127.0.0.1:{port}")
        start = time.monotonic()
        bridge.close()
        assert time.monotonic() - start < 1.5  # 0.5 s for the master


@pytest.mark.parametrize(
    "uri", ["localhost:11311", "http://", "http://host", "http://h:x", "https://h:1"]
)
def test_a_master_that_cannot_be(inbox, uri):
    with pytest.raises(ValueError, match=r"allowed is http://HOST:PORT"):
        Ros1Bridge(inbox, [], master=uri)


def test_a_host_that_peers_cannot_reach(inbox):
    with pytest.raises(ValueError, match=r"host is '0.0.0.0'; allowed is one IPv4"):
        Ros1Bridge(inbox, [], host="0.0.0.0")


def test_an_interface_for_a_host(inbox, ros1_master):
    bridge = Ros1Bridge(inbox, TOPICS, master=ros1_master.uri, host="lo")
    with contextlib.closing(bridge):
        ((_, _, uri), *_) = ros1_master.registered.values()
        assert uri.startswith("http://127.0.0.1:")


def test_a_node_that_cannot_start_leaves_nothing_behind(inbox, monkeypatch):
    listeners = []

    async def fail(listener, *_):
        listeners.append(listener)
        raise OSError("no")

    monkeypatch.setattr(ros1_node, "serve", fail)
    with pytest.raises(OSError, match="no"):
        Ros1Bridge(inbox, TOPICS, master="http://127.0.0.1:9")
    assert listeners[0].fileno() == -1
    assert not [t for t in threading.enumerate() if t.name == "ros1"]


def test_hosts_of_publishers_that_are_not_found_keep_nobody_waiting(
    inbox, ros1_master, ros1_publisher, impatient, monkeypatch, told
):
    given_up, real = threading.Event(), socket.getaddrinfo

    def getaddrinfo(host, *arguments, **options):
        if str(host).startswith("robot"):
            given_up.wait(20.0)
            raise socket.gaierror(-3, "Temporary failure in name resolution")
        return real(host, *arguments, **options)

    monkeypatch.setattr(socket, "getaddrinfo", getaddrinfo)
    uri = ros1_master.uri.replace("127.0.0.1", "localhost")
    with contextlib.closing(Ros1Bridge(inbox, TOPICS, master=uri)) as bridge:
        robots = [f"http://robot{i}:1234/" for i in range(40)]
        ros1_master.tell("/grasp", *robots, ros1_publisher.uri)
        ros1_publisher.accept(**INT32).sendall(int32(7))
        assert taken(inbox, "closure") == [0.07]
        ros1_master.registered.clear()  # as if there were a new one
        assert wait_until(lambda: len(ros1_master.registered) == 6)
        start = time.monotonic()
        bridge.close()
        assert time.monotonic() - start < 1.5  # as where the master hangs
    assert not told.about("roscore")
    given_up.set()


def test_the_master_of_the_environment(inbox, monkeypatch):
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:9")
    with contextlib.closing(Ros1Bridge(inbox, [])) as bridge:
        assert bridge.status.startswith("ROS 1 at http://127.0.0.1:9")
    monkeypatch.delenv("ROS_MASTER_URI")
    with contextlib.closing(Ros1Bridge(inbox, [])) as bridge:
        assert bridge.status.startswith("ROS 1 at http://localhost:11311")


def test_being_shut_down_leaves_the_simulation_alone(
    ros1_bridge, inbox, ros1_master, told
):
    connection, _ = peers.subscribe(ros1_master.node, "/clock", md5sum="*")
    assert not ros1_bridge.closed
    assert ros1_master.node.shutdown("/rosnode", "user request")[0] == 1
    assert wait_until(lambda: ros1_bridge.closed)
    assert ros1_bridge.status == "ROS 1 shut down"
    assert wait_until(lambda: ros1_master.registered == {})
    with pytest.raises(ConnectionError):
        peers.receive(connection, 1)
    ros1_bridge.publish(CLOCK, 1.0, [])
    assert not ros1_bridge.has_subscribers("/clock")
    assert len(told.about("user request")) == 1
