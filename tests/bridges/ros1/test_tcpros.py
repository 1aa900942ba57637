import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.bridges.ros1.tcpros import (
    FRAME_LIMIT,
    Frames,
    TcprosError,
    decode_header,
    encode_header,
    frame,
)

names = st.text(st.characters(codec="ascii", exclude_characters="="), min_size=1)
values = st.text(st.characters(codec="utf-8"))


def content(framed):
    (size,) = struct.unpack("<I", framed[:4])
    assert size == len(framed) - 4
    return framed[4:]


def test_a_header_is_framed_as_the_protocol_says():
    # The example of wiki.ros.org/ROS/Connection Header, its first two fields.
    header = {"message_definition": "string data\n\n", "callerid": "/rostopic_4767"}
    definition = b"\x20\0\0\0message_definition=string data\n\n"
    caller = b"\x17\0\0\0callerid=/rostopic_4767"
    size = struct.pack("<I", len(definition) + len(caller))
    assert encode_header(header) == size + definition + caller


@given(st.dictionaries(names, values))
def test_a_header_comes_back(fields):
    assert decode_header(content(encode_header(fields))) == fields


def frames_of(messages):
    return b"".join(map(frame, messages))


@given(st.binary(max_size=200) | st.lists(st.binary(), max_size=5).map(frames_of))
def test_what_is_no_header_is_an_error_and_nothing_else(data):
    try:
        fields = decode_header(data)
    except TcprosError:
        return
    assert all(fields)


@given(st.lists(st.binary(max_size=50)), st.lists(st.integers(0, 60)))
def test_any_chopping_of_the_stream_gives_the_same_messages(messages, pieces):
    stream, frames, found = frames_of(messages), Frames(), []
    for size in [*pieces, len(stream)]:
        found += frames.feed(stream[:size])
        stream = stream[size:]
    assert found == messages
    assert frames.pending == 0


def test_half_a_frame_waits_for_the_other_half():
    frames = Frames()
    assert list(frames.feed(frame(b"12") + frame(b"345")[:-1])) == [b"12"]
    assert frames.pending == 6
    assert list(frames.feed(b"5")) == [b"345"]


def test_a_frame_that_says_it_is_huge_is_refused_at_once():
    frames = Frames()
    assert list(frames.feed(struct.pack("<I", FRAME_LIMIT))) == []
    with pytest.raises(TcprosError, match="allowed are up to 1048576"):
        list(Frames().feed(struct.pack("<I", FRAME_LIMIT + 1)))


def test_what_came_before_a_bad_length_is_not_lost():
    found = []
    with pytest.raises(TcprosError):
        for message in Frames().feed(frame(b"good") + b"\xff" * 4):
            found.append(message)
    assert found == [b"good"]
