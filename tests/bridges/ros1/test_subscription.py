import contextlib
import struct
import time

import numpy as np
import pytest

from bridges.ros1 import ros1_peers as peers
from bridges.ros1.ros1_peers import (
    ARRAY,
    ARRAY_MD5,
    INT32,
    INT32_MD5,
    array,
    int32,
    taken,
    wait_until,
)
from drake_srg.bridges.ros1 import subscription as ros1_subscription


def test_commands_arrive(ros1_bridge, inbox, ros1_master, ros1_publisher, told):
    ros1_master.tell("/grasp", ros1_publisher.uri)
    connection = ros1_publisher.accept(**INT32)
    message_definition = ros1_publisher.header.pop("message_definition")
    assert message_definition == "int32 data\n"
    assert ros1_publisher.header == {
        "callerid": "/drake_srg",
        "md5sum": INT32_MD5,
        "tcp_nodelay": "1",
        "topic": "/grasp",
        "type": "std_msgs/Int32",
    }
    connection.sendall(int32(42))
    assert taken(inbox, "closure") == [0.42]
    assert told == []


def test_an_array_in_pieces(ros1_bridge, inbox, ros1_master, ros1_publisher):
    ros1_master.tell("/kuka", ros1_publisher.uri)
    connection = ros1_publisher.accept(**ARRAY)
    message = array(1.0, -2.0, 3.5)
    for piece in (message[:2], message[2:20], message[20:-1]):
        connection.sendall(piece)
        time.sleep(0.02)
        assert inbox.take() == {}
    connection.sendall(message[-1:])
    assert taken(inbox, "arm") == [1.0, -2.0, 3.5]


def test_a_burst_loses_no_last_value(ros1_bridge, inbox, ros1_master, ros1_publisher):
    ros1_master.tell("/grasp", ros1_publisher.uri)
    connection = ros1_publisher.accept(**INT32)
    connection.sendall(b"".join(int32(i % 100) for i in range(10_000)) + int32(99))
    assert wait_until(lambda: inbox.received == 10_001)
    assert inbox.take()["closure"] == [0.99]


def test_bad_messages_are_refused_and_counted(
    ros1_bridge, inbox, ros1_master, ros1_publisher, told
):
    ros1_master.tell("/kuka", ros1_publisher.uri)
    connection = ros1_publisher.accept(**ARRAY)
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
    assert warning.startswith("/kuka: is no std_msgs/Float64MultiArray: ")


def test_a_command_out_of_range_is_warned_of(
    ros1_bridge, inbox, ros1_master, ros1_publisher, told
):
    ros1_master.tell("/grasp", ros1_publisher.uri)
    ros1_publisher.accept(**INT32).sendall(int32(50) + int32(101) + int32(-1))
    assert wait_until(lambda: inbox.received == 3)
    assert inbox.take()["closure"] == [0.5]
    assert told == ["/grasp: is 101; the last good command holds"]


@pytest.mark.parametrize(
    ("answer", "sent", "warning"),
    [
        (INT32, b"\xff\xff\xff\xff", "length of 4294967295 bytes"),
        (INT32 | {"md5sum": ARRAY_MD5}, int32(1), f"std_msgs/Int32 with {INT32_MD5}"),
        ({"error": "go\x1b away"}, b"", "refuses us: 'go\\x1b away'"),
        ({}, b"\x05\0\0\0hello", "a header"),
    ],
)
def test_a_publisher_that_does_not_fit_is_tried_again(
    ros1_bridge, inbox, ros1_master, ros1_publisher, told, answer, sent, warning
):
    ros1_master.tell("/grasp", ros1_publisher.uri)
    for _ in range(2):
        connection = ros1_publisher.accept(**answer)
        connection.sendall(sent)
        with contextlib.suppress(ConnectionResetError):
            assert connection.recv(1) == b""
    ros1_publisher.accept(**INT32).sendall(int32(3))
    assert taken(inbox, "closure") == [0.03]
    (text,) = told
    assert warning in text


def test_publishers_come_and_go(ros1_bridge, inbox, ros1_master, ros1_publisher, told):
    ros1_master.tell("/grasp", ros1_publisher.uri)
    vanishing = ros1_publisher.accept(**INT32)
    vanishing.sendall(int32(5)[:6])
    vanishing.close()  # it comes again
    first = ros1_publisher.accept(**INT32)
    with contextlib.closing(peers.Publisher()) as other:
        ros1_master.tell("/grasp", ros1_publisher.uri, other.uri)
        second = other.accept(**INT32)
        for connection, value in (first, 10), (second, 20), (first, 30):
            connection.sendall(int32(value))
            assert taken(inbox, "closure") == [value / 100]
        ros1_master.tell("/grasp", other.uri)
        first.close()
        second.sendall(int32(40))
        assert taken(inbox, "closure") == [0.4]
    (text,) = told
    assert "in the middle of a message" in text


def test_who_leaves_is_missed_only_if_it_stays_listed(
    ros1_bridge, inbox, ros1_master, ros1_publisher, told, monkeypatch
):
    ros1_master.tell("/grasp", ros1_publisher.uri)
    connection = ros1_publisher.accept(**INT32)
    connection.sendall(int32(5))
    assert taken(inbox, "closure") == [0.05]
    told_at_attempts = []

    async def nobody_answers(uri, *arguments, **options):
        told_at_attempts.append(list(told))
        raise ConnectionRefusedError("nobody there")

    monkeypatch.setattr(ros1_subscription, "call", nobody_answers)
    connection.close()
    assert wait_until(lambda: told)
    assert told_at_attempts[:2] == [[], []]  # not told of the first one
    (text,) = told
    assert "cannot be reached" in text


@pytest.mark.parametrize(
    "uri", ["http://127.0.0.1:9/", "nonsense", "http://a b:1/", "http://127.0.0.1:0/"]
)
def test_a_publisher_that_cannot_be_reached(
    ros1_bridge, inbox, ros1_master, ros1_publisher, told, uri
):
    ros1_master.tell("/grasp", uri)
    assert wait_until(lambda: told)
    ros1_master.tell("/grasp", uri, ros1_publisher.uri)
    ros1_publisher.accept(**INT32).sendall(int32(1))
    assert taken(inbox, "closure") == [0.01]
    time.sleep(0.2)
    (text,) = told
    assert "/grasp" in text
    assert "cannot be reached" in text
