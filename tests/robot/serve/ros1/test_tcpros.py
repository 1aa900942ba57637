import asyncio
import contextlib
import socket
import struct
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.robot.serve.ros1 import tcpros
from drake_srg.robot.serve.ros1.tcpros import (
    FRAME_LIMIT,
    TcprosError,
    decode_header,
    encode_header,
    frame,
    frames,
)
from robot.serve.ros1 import peers
from robot.serve.ros1.peers import (
    ARRAY,
    ARRAY_MD5,
    CLOCK,
    CLOCK_MD5,
    IMAGE,
    INT32,
    INT32_MD5,
    JOINTS,
    array,
    int32,
    taken,
)
from robot.serve.waiting import wait_until

names = st.text(st.characters(codec="ascii", exclude_characters="="), min_size=1)
values = st.text(st.characters(codec="utf-8"))


def content(framed):
    (size,) = struct.unpack("<I", framed[:4])
    assert size == len(framed) - 4
    return framed[4:]


def test_a_header_is_framed_as_the_specification_shows():
    # The first two fields of the example in wiki.ros.org/ROS/Connection Header.
    header = {"message_definition": "string data\n\n", "callerid": "/rostopic_4767"}
    definition = b"\x20\0\0\0message_definition=string data\n\n"
    caller = b"\x17\0\0\0callerid=/rostopic_4767"
    size = struct.pack("<I", len(definition) + len(caller))
    assert encode_header(header) == size + definition + caller


@given(st.dictionaries(names, values, max_size=5))
def test_a_header_survives_encoding_and_decoding(fields):
    assert decode_header(content(encode_header(fields))) == fields


def frames_of(messages):
    return b"".join(map(frame, messages))


@given(st.binary(max_size=200) | st.lists(st.binary(), max_size=5).map(frames_of))
def test_arbitrary_bytes_are_a_header_or_raise_an_error(data):
    try:
        fields = decode_header(data)
    except TcprosError:
        return
    assert all(fields)


def read(stream):
    async def read_all():
        reader = asyncio.StreamReader()
        reader.feed_data(stream)
        reader.feed_eof()
        return [content async for content in frames(reader)]

    return asyncio.run(read_all())


def test_frames_are_read_until_the_stream_ends():
    messages = [b"", b"one", bytes(FRAME_LIMIT)]
    assert read(frames_of(messages)) == messages
    with pytest.raises(TcprosError, match="at most 1048576 bytes, got 1048577"):
        read(struct.pack("<I", FRAME_LIMIT + 1))
    for end in (1, 4, 6):
        with pytest.raises(TcprosError, match="in the middle of a message"):
            read(frame(b"one")[:end])


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


def test_a_subscriber_misses_no_message_after_its_answer(bridge, master, monkeypatch):
    encode, subscribed = tcpros.encode_header, []

    def answer(fields):
        subscribed.append(bridge.has_subscribers("/clock"))
        return encode(fields)

    monkeypatch.setattr(tcpros, "encode_header", answer)
    peers.subscribe(master.node, "/clock", md5sum="*", type="*")
    assert subscribed == [True]


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


@pytest.mark.slow
@pytest.mark.parametrize("garbage", [b"GET / HTTP/1.1\r\n\r\n", b"\xff" * 8, b"\x08"])
def test_garbage_instead_of_a_header_ends_its_connection_only(
    bridge, master, garbage, monkeypatch
):
    monkeypatch.setattr(tcpros, "_HANDSHAKE", 0.5)
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
        assert peers.receive_frame(reading)[:8] == struct.pack("<II", i, i)
    numbers = []
    while not numbers or numbers[-1] < count - 1:
        numbers.append(struct.unpack("<I", peers.receive_frame(stuck)[:4])[0])
    # First the contents of the system's buffers, then those of the queue.
    assert numbers == sorted(numbers)
    assert len(numbers) < count
    assert numbers[-10:] == list(range(count - 10, count))


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


def test_a_message_becomes_a_command(bridge, inbox, master, publisher, told):
    master.tell("/grasp", publisher.uri)
    connection = publisher.accept(**INT32)
    message_definition = publisher.header.pop("message_definition")
    assert message_definition == "int32 data\n"
    assert publisher.header == {
        "callerid": "/drake_srg",
        "md5sum": INT32_MD5,
        "tcp_nodelay": "1",
        "topic": "/grasp",
        "type": "std_msgs/Int32",
    }
    connection.sendall(int32(42))
    assert taken(inbox, "closure") == [0.42]
    assert told == []


def test_malformed_messages_are_refused_and_counted(
    bridge, inbox, master, publisher, told
):
    master.tell("/kuka", publisher.uri)
    connection = publisher.accept(**ARRAY)
    generator = np.random.default_rng(0)
    good = array(1.0, 2.0)[4:]
    bad = [good[:-1], good + b"\0", b"", *(good[:size] for size in range(len(good)))]
    bad += [generator.bytes(size) for size in range(1, 60)]
    for content in bad:
        connection.sendall(struct.pack("<I", len(content)) + content)
    connection.sendall(array(5.0))
    assert wait_until(lambda: inbox.received == len(bad) + 1)
    assert inbox.take()["arm"].tolist() == [5.0]
    (warning,) = told
    assert warning.startswith("/kuka: must be a std_msgs/Float64MultiArray: ")


@pytest.mark.parametrize(
    ("answer", "sent", "warning"),
    [
        (INT32, b"\xff\xff\xff\xff", "at most 1048576 bytes, got 4294967295"),
        (INT32 | {"md5sum": ARRAY_MD5}, int32(1), f"Int32 with MD5 sum {INT32_MD5}"),
        ({"error": "go\x1b away"}, b"", "refuses: 'go\\x1b away'"),
        ({}, b"\x05\0\0\0hello", "invalid header"),
    ],
)
def test_an_unsuitable_publisher_is_tried_again_with_one_warning(
    bridge, inbox, master, publisher, told, answer, sent, warning
):
    master.tell("/grasp", publisher.uri)
    for _ in range(2):
        connection = publisher.accept(**answer)
        connection.sendall(sent)
        with contextlib.suppress(ConnectionResetError):
            assert connection.recv(1) == b""
    publisher.accept(**INT32).sendall(int32(3))
    assert taken(inbox, "closure") == [0.03]
    (text,) = told
    assert warning in text


def test_commands_go_on_after_an_unexpected_error(
    bridge, inbox, master, publisher, told, monkeypatch
):
    receive = inbox.receive

    def fail_once(topic, data):
        monkeypatch.setattr(inbox, "receive", receive)
        raise RuntimeError("unforeseen")

    monkeypatch.setattr(inbox, "receive", fail_once)
    master.tell("/grasp", publisher.uri)
    publisher.accept(**INT32).sendall(int32(1))
    publisher.accept(**INT32).sendall(int32(2))
    assert taken(inbox, "closure") == [0.02]
    (text,) = told
    assert "unforeseen" in text


@pytest.mark.parametrize("answer", [[], ["UDPROS"], ["TCPROS", "127.0.0.1", 0], 7])
def test_a_publisher_without_a_tcpros_address_is_reported(bridge, master, told, answer):
    peer = peers.Api(requestTopic=lambda *_: [1, "", answer])
    with contextlib.closing(peer):
        master.tell("/grasp", peer.uri)
        assert wait_until(lambda: told)
    assert f"invalid answer to requestTopic: {answer}" in told[0]


def test_publishers_come_and_go(bridge, inbox, master, publisher, told):
    master.tell("/grasp", publisher.uri)
    vanishing = publisher.accept(**INT32)
    vanishing.sendall(int32(5)[:6])
    vanishing.close()  # the bridge connects again
    first = publisher.accept(**INT32)
    with contextlib.closing(peers.Publisher()) as other:
        master.tell("/grasp", publisher.uri, other.uri)
        second = other.accept(**INT32)
        for connection, value in (first, 10), (second, 20), (first, 30):
            connection.sendall(int32(value))
            assert taken(inbox, "closure") == [value / 100]
        master.tell("/grasp", other.uri)
        first.close()
        second.sendall(int32(40))
        assert taken(inbox, "closure") == [0.4]
    (text,) = told
    assert "in the middle of a message" in text


@pytest.mark.parametrize(
    "uri", ["http://127.0.0.1:9/", "nonsense", "http://a b:1/", "http://127.0.0.1:0/"]
)
def test_an_unreachable_publisher_is_reported_once_and_stops_no_other(
    bridge, inbox, master, publisher, told, uri
):
    master.tell("/grasp", uri)
    assert wait_until(lambda: told)
    master.tell("/grasp", uri, publisher.uri)
    publisher.accept(**INT32).sendall(int32(1))
    assert taken(inbox, "closure") == [0.01]
    time.sleep(0.2)
    (text,) = told
    assert "/grasp" in text
    assert "cannot be reached" in text
