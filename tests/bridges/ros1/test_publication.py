import asyncio
import contextlib
import dataclasses as dc
import socket
import struct

import numpy as np
import pytest

from bridges.ros1 import peers
from bridges.ros1.peers import CLOCK, CLOCK_MD5, IMAGE, INT32_MD5, JOINTS
from bridges.waiting import wait_until
from drake_srg.bridges.commands import Warnings
from drake_srg.bridges.ros1.publication import SubscriberConnection
from drake_srg.bridges.ros1.timing import Timing


def test_a_subscriber_receives_a_header_and_messages(bridge, master):
    assert not bridge.has_subscribers("/clock")
    bridge.publish(CLOCK, 0.5, [])  # without a subscriber
    connection, header = peers.subscribe(
        master.node, "/clock", md5sum=CLOCK_MD5, type="rosgraph_msgs/Clock"
    )
    assert header.pop("message_definition").startswith("time clock")
    assert header == {
        "callerid": "/drake_srg",
        "latching": "0",
        "md5sum": CLOCK_MD5,
        "topic": "/clock",
        "type": "rosgraph_msgs/Clock",
    }
    assert wait_until(lambda: bridge.has_subscribers("/clock"))
    bridge.publish(CLOCK, 1.25, [])
    assert peers.receive_frame(connection) == struct.pack("<II", 1, 250_000_000)


def test_the_system_does_not_delay_small_messages():
    class Transport(asyncio.Transport):
        def set_write_buffer_limits(self, high=None, low=None):
            assert high == 0  # nor does asyncio

    async def connect(ours):
        connection = SubscriberConnection("/node", {}, set(), Warnings(print), Timing())
        connection.connection_made(Transport({"socket": ours}))
        connection.connection_lost(None)

    with socket.socket() as ours:
        asyncio.run(connect(ours))
        assert ours.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) == 1


def test_headers_of_messages_count_up_on_each_topic(bridge, master):
    connection, _ = peers.subscribe(master.node, "/joint_states", md5sum="*", type="*")
    for _ in range(3):
        bridge.publish(JOINTS, 1.0, [np.arange(4.0), None])
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
def test_an_unsuitable_subscriber_is_refused_with_a_reason(
    bridge, master, told, topic, fields, error
):
    address = peers.tcpros_address(master.node, "/clock")
    for _ in range(2):
        with socket.create_connection(address, timeout=20.0) as connection:
            connection.sendall(peers.header(callerid="/peer", topic=topic, **fields))
            assert error in peers.receive_header(connection)["error"]
            assert connection.recv(1) == b""
    assert len(told.about("refused a subscriber")) == 1
    assert not bridge.has_subscribers("/clock")


def test_a_header_may_arrive_byte_by_byte(bridge, master):
    address = peers.tcpros_address(master.node, "/clock")
    with socket.create_connection(address, timeout=20.0) as connection:
        for byte in peers.header(callerid="/peer", topic="/clock", md5sum="*"):
            connection.sendall(bytes([byte]))
        assert peers.receive_header(connection)["type"] == "rosgraph_msgs/Clock"


@pytest.mark.slow
@pytest.mark.parametrize("garbage", [b"GET / HTTP/1.1\r\n\r\n", b"\xff" * 8, b"\x08"])
def test_garbage_instead_of_a_header_ends_its_connection_only(
    new_bridge, timing, master, garbage
):
    new_bridge(master=master.uri, timing=dc.replace(timing, handshake=0.5))
    assert wait_until(lambda: len(master.registered) == 6)
    address = peers.tcpros_address(master.node, "/clock")
    with socket.create_connection(address, timeout=20.0) as connection:
        connection.sendall(garbage)
        with contextlib.suppress(ConnectionResetError):
            while connection.recv(100):
                pass
    peers.subscribe(master.node, "/clock", md5sum="*")


def test_a_subscriber_that_reads_nothing_loses_the_oldest_messages(bridge, master):
    stuck, _ = peers.subscribe(master.node, "/image", md5sum="*")
    reading, _ = peers.subscribe(master.node, "/image", md5sum="*")
    pixels = np.zeros((480, 640, 3), np.uint8)
    count = 60
    for i in range(count):
        bridge.publish(IMAGE, float(i), [pixels])
        frame = peers.receive_frame(reading)
        assert frame[:8] == struct.pack("<II", i, i)
    numbers = []
    while not numbers or numbers[-1] < count - 1:
        numbers.append(struct.unpack("<I", peers.receive_frame(stuck)[:4])[0])
    # First the contents of the system's buffers, then those of the queue.
    assert numbers == sorted(numbers)
    assert len(numbers) < count
    assert numbers[-10:] == list(range(count - 10, count))

    def sent():
        topics = {topic: rows for topic, _, rows in master.node.getBusStats("/x")[2][0]}
        return sorted(messages for _, _, messages, _ in topics["/image"])

    assert wait_until(lambda: sent() == [len(numbers), count])


def test_a_vanishing_subscriber_does_not_disturb_others(bridge, master):
    vanishing, _ = peers.subscribe(master.node, "/clock", md5sum="*")
    staying, _ = peers.subscribe(master.node, "/clock", md5sum="*")
    # A reset instead of a regular close.
    vanishing.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    vanishing.close()
    for i in range(20):
        bridge.publish(CLOCK, float(i), [])
        assert peers.receive_frame(staying) == struct.pack("<II", i, 0)
    staying.close()
    assert wait_until(lambda: not bridge.has_subscribers("/clock"))
