import contextlib
import struct
import time

import numpy as np
import pytest

from bridges.ros1 import peers
from bridges.ros1.peers import ARRAY, ARRAY_MD5, INT32, INT32_MD5, array, int32, taken
from bridges.waiting import wait_until
from drake_srg.bridges.ros1 import subscription as ros1_subscription


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


def test_a_message_may_arrive_in_pieces(bridge, inbox, master, publisher):
    master.tell("/kuka", publisher.uri)
    connection = publisher.accept(**ARRAY)
    message = array(1.0, -2.0, 3.5)
    for piece in (message[:2], message[2:20], message[20:-1]):
        connection.sendall(piece)
        time.sleep(0.02)
        assert inbox.take() == {}
    connection.sendall(message[-1:])
    assert taken(inbox, "arm") == [1.0, -2.0, 3.5]


def test_a_burst_of_messages_keeps_the_last_value(bridge, inbox, master, publisher):
    master.tell("/grasp", publisher.uri)
    connection = publisher.accept(**INT32)
    connection.sendall(b"".join(int32(i % 100) for i in range(10_000)) + int32(99))
    assert wait_until(lambda: inbox.received == 10_001)
    assert inbox.take()["closure"] == [0.99]


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


def test_a_command_out_of_range_is_refused_with_one_warning(
    bridge, inbox, master, publisher, told
):
    master.tell("/grasp", publisher.uri)
    publisher.accept(**INT32).sendall(int32(50) + int32(101) + int32(-1))
    assert wait_until(lambda: inbox.received == 3)
    assert inbox.take()["closure"] == [0.5]
    assert told == ["/grasp: is 101; the last good command holds"]


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


def test_a_publisher_that_left_is_reported_only_if_it_stays_listed(
    bridge, inbox, master, publisher, told, monkeypatch
):
    master.tell("/grasp", publisher.uri)
    connection = publisher.accept(**INT32)
    connection.sendall(int32(5))
    assert taken(inbox, "closure") == [0.05]
    told_at_attempts = []

    async def nobody_answers(uri, *arguments, **options):
        told_at_attempts.append(list(told))
        raise ConnectionRefusedError("nobody there")

    monkeypatch.setattr(ros1_subscription, "call", nobody_answers)
    connection.close()
    assert wait_until(lambda: told)
    assert told_at_attempts[:2] == [[], []]  # the first failure is not reported
    (text,) = told
    assert "cannot be reached" in text


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
