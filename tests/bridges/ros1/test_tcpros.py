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


def test_a_header_is_framed_as_the_specification_shows():
    # The first two fields of the example in wiki.ros.org/ROS/Connection Header.
    header = {"message_definition": "string data\n\n", "callerid": "/rostopic_4767"}
    definition = b"\x20\0\0\0message_definition=string data\n\n"
    caller = b"\x17\0\0\0callerid=/rostopic_4767"
    size = struct.pack("<I", len(definition) + len(caller))
    assert encode_header(header) == size + definition + caller


@given(st.dictionaries(names, values))
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


@given(st.lists(st.binary(max_size=50)), st.lists(st.integers(0, 60)))
def test_frames_do_not_depend_on_how_the_stream_is_cut(messages, pieces):
    stream, frames, found = frames_of(messages), Frames(), []
    for size in [*pieces, len(stream)]:
        found += frames.feed(stream[:size])
        stream = stream[size:]
    assert found == messages
    assert frames.pending == 0


def test_half_a_frame_waits_for_the_rest():
    frames = Frames()
    assert list(frames.feed(frame(b"12") + frame(b"345")[:-1])) == [b"12"]
    assert frames.pending == 6
    assert list(frames.feed(b"5")) == [b"345"]


def test_a_frame_longer_than_the_limit_is_refused_at_once():
    frames = Frames()
    assert list(frames.feed(struct.pack("<I", FRAME_LIMIT))) == []
    with pytest.raises(TcprosError, match="at most 1048576 bytes, got 1048577"):
        list(Frames().feed(struct.pack("<I", FRAME_LIMIT + 1)))


def test_frames_before_an_invalid_length_are_not_lost():
    found = []
    with pytest.raises(TcprosError):
        for message in Frames().feed(frame(b"good") + b"\xff" * 4):
            found.append(message)
    assert found == [b"good"]
