import contextlib
import socket
import struct

import numpy as np
import pytest

from bridges.ros1 import ros1_peers as peers
from bridges.ros1.ros1_peers import (
    CLOCK,
    CLOCK_MD5,
    IMAGE,
    INT32_MD5,
    JOINTS,
    TOPICS,
    wait_until,
)
from drake_srg.bridges.ros1 import publication as ros1_publication
from drake_srg.bridges.ros1.bridge import Ros1Bridge


def test_a_subscriber_gets_header_and_messages(ros1_bridge, ros1_master):
    assert not ros1_bridge.has_subscribers("/clock")
    ros1_bridge.publish(CLOCK, 0.5, [])  # nobody hears
    connection, header = peers.subscribe(
        ros1_master.node, "/clock", md5sum=CLOCK_MD5, type="rosgraph_msgs/Clock"
    )
    assert header.pop("message_definition").startswith("time clock")
    assert header == {
        "callerid": "/drake_srg",
        "latching": "0",
        "md5sum": CLOCK_MD5,
        "topic": "/clock",
        "type": "rosgraph_msgs/Clock",
    }
    assert wait_until(lambda: ros1_bridge.has_subscribers("/clock"))
    ros1_bridge.publish(CLOCK, 1.25, [])
    assert peers.receive_frame(connection) == struct.pack("<II", 1, 250_000_000)


def test_small_messages_do_not_wait_for_more(ros1_bridge, ros1_master):
    _connection, _ = peers.subscribe(ros1_master.node, "/clock", md5sum="*")
    (ours,) = ros1_bridge._publications["/clock"].connections
    ours_socket = ours._transport.get_extra_info("socket")
    assert ours_socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) == 1


def test_messages_are_numbered_by_topic(ros1_bridge, ros1_master):
    connection, _ = peers.subscribe(
        ros1_master.node, "/joint_states", md5sum="*", type="*"
    )
    for _ in range(3):
        ros1_bridge.publish(JOINTS, 1.0, [np.arange(4.0), None])
    numbers = [peers.receive_frame(connection)[:4] for _ in range(3)]
    assert numbers == [struct.pack("<I", i) for i in range(3)]


@pytest.mark.parametrize(
    ("topic", "fields", "error"),
    [
        ("/clock", {"md5sum": INT32_MD5, "type": "std_msgs/Int32"}, CLOCK_MD5),
        ("/nothing", {"md5sum": "*"}, "/clock, /image, /joint_states"),
        ("/clock", {}, "'md5sum'"),
    ],
)
def test_a_subscriber_that_does_not_fit_is_told(
    ros1_bridge, ros1_master, told, topic, fields, error
):
    _, _, (_, host, port) = ros1_master.node.requestTopic("/p", "/clock", [["TCPROS"]])
    for _ in range(2):
        with socket.create_connection((host, port), timeout=5.0) as connection:
            connection.sendall(peers.header(callerid="/peer", topic=topic, **fields))
            assert error in peers.receive_header(connection)["error"]
            assert connection.recv(1) == b""
    assert len(told.about("a subscriber is refused")) == 1
    assert not ros1_bridge.has_subscribers("/clock")


def test_a_header_may_come_byte_by_byte(ros1_bridge, ros1_master):
    _, _, (_, host, port) = ros1_master.node.requestTopic("/p", "/clock", [["TCPROS"]])
    with socket.create_connection((host, port), timeout=5.0) as connection:
        for byte in peers.header(callerid="/peer", topic="/clock", md5sum="*"):
            connection.sendall(bytes([byte]))
        assert peers.receive_header(connection)["type"] == "rosgraph_msgs/Clock"


@pytest.mark.parametrize("garbage", [b"GET / HTTP/1.1\r\n\r\n", b"\xff" * 8, b"\x08"])
def test_garbage_for_a_header(inbox, ros1_master, garbage, monkeypatch):
    monkeypatch.setattr(ros1_publication, "HANDSHAKE_TIMEOUT", 0.2)
    with contextlib.closing(Ros1Bridge(inbox, TOPICS, master=ros1_master.uri)):
        assert wait_until(lambda: len(ros1_master.registered) == 6)
        _, _, (_, host, port) = ros1_master.node.requestTopic(
            "/p", "/clock", [["TCPROS"]]
        )
        with socket.create_connection((host, port), timeout=5.0) as connection:
            connection.sendall(garbage)
            with contextlib.suppress(ConnectionResetError):
                while connection.recv(100):
                    pass
        connection, _ = peers.subscribe(ros1_master.node, "/clock", md5sum="*")


def test_a_subscriber_that_reads_nothing_loses_the_oldest(ros1_bridge, ros1_master):
    stuck, _ = peers.subscribe(ros1_master.node, "/image", md5sum="*")
    reading, _ = peers.subscribe(ros1_master.node, "/image", md5sum="*")
    pixels = np.zeros((480, 640, 3), np.uint8)
    count = 60
    for i in range(count):
        ros1_bridge.publish(IMAGE, float(i), [pixels])
        frame = peers.receive_frame(reading)
        assert frame[:8] == struct.pack("<II", i, i)
    (info,) = [
        c.info
        for c in ros1_bridge._publications["/image"].connections
        if c.info.messages < count
    ]
    numbers = []
    while not numbers or numbers[-1] < count - 1:
        numbers.append(struct.unpack("<I", peers.receive_frame(stuck)[:4])[0])
    # What was in the system's buffers, then what the queue kept.
    assert numbers == sorted(numbers)
    assert len(numbers) < count
    assert numbers[-10:] == list(range(count - 10, count))
    assert wait_until(lambda: info.messages == len(numbers))


def test_subscribers_that_vanish_do_not_matter(ros1_bridge, ros1_master):
    vanishing, _ = peers.subscribe(ros1_master.node, "/clock", md5sum="*")
    staying, _ = peers.subscribe(ros1_master.node, "/clock", md5sum="*")
    # Reset instead of a goodbye.
    vanishing.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    vanishing.close()
    for i in range(20):
        ros1_bridge.publish(CLOCK, float(i), [])
        assert peers.receive_frame(staying) == struct.pack("<II", i, 0)
    staying.close()
    assert wait_until(lambda: not ros1_bridge.has_subscribers("/clock"))
