"""Streams of packets, the same in both protocols."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.bridges.dynamixel.protocol import BROADCAST, Instruction, PacketReader
from drake_srg.bridges.dynamixel.protocol1 import Packet1
from drake_srg.bridges.dynamixel.protocol2 import Packet2

KINDS = pytest.mark.parametrize("kind", [Packet1, Packet2])
fields = st.tuples(
    st.integers(0, BROADCAST).filter(lambda number: number != 253),
    st.integers(0, 255),
    # Bytes of headers are the ones to stumble over.
    st.one_of(
        st.binary(max_size=253),
        st.lists(st.sampled_from(b"\xff\xfd\x00"), max_size=60).map(bytes),
    ),
)


def fed(reader, data, time=0.0):
    return list(reader.feed(data, time))


@KINDS
@given(st.lists(fields, max_size=4), st.lists(st.integers(0, 400)))
def test_a_stream_may_be_cut_anywhere(kind, sent, cuts):
    sent = [kind(*packet) for packet in sent]
    stream = b"".join(packet.encode() for packet in sent)
    ends = sorted({min(cut, len(stream)) for cut in cuts} | {len(stream)})
    reader, received, start = PacketReader(kind), [], 0
    for end in ends:
        received += fed(reader, stream[start:end])
        start = end
    assert received == sent
    assert reader.dropped == 0


@KINDS
@given(st.binary(), fields)
def test_a_packet_is_found_after_garbage_and_a_pause(kind, garbage, packet):
    reader, packet = PacketReader(kind), kind(*packet)
    fed(reader, garbage, 0.0)
    assert fed(reader, packet.encode(), 0.2) == [packet]


@KINDS
@given(st.binary(), fields)
def test_a_packet_is_found_at_once_after_bytes_that_cannot_begin_one(
    kind, garbage, packet
):
    garbage, packet = garbage.replace(b"\xff", b""), kind(*packet)
    reader = PacketReader(kind)
    assert fed(reader, garbage + packet.encode()) == [packet]
    assert reader.dropped == len(garbage)


@pytest.mark.parametrize(
    ("kind", "beginning"),
    [
        (Packet1, b"\xff\xff\x01\x05\x03"),
        (Packet2, b"\xff\xff\xfd\x00\x01\x07\x00\x03"),
    ],
)
def test_a_packet_is_found_within_a_broken_one(kind, beginning):
    read = kind(1, Instruction.READ, b"\x24\x00\x02\x00")
    broken, *rest = fed(PacketReader(kind), beginning + read.encode())
    assert not broken.intact
    assert rest == [read]


@KINDS
@given(fields, st.integers(0, 258), st.integers(1, 255))
def test_a_changed_byte_is_detected(kind, packet, at, change):
    packet = kind(*packet)
    wire, start = bytearray(packet.encode()), len(kind.header)
    wire[start + at % (len(wire) - start)] ^= change
    found = fed(PacketReader(kind), bytes(wire) + bytes(1024))
    assert all(not p.intact for p in found if p.id == packet.id)


@pytest.mark.slow
@KINDS
@given(chunks=st.lists(st.binary(max_size=2000), max_size=5))
def test_the_buffer_stays_shorter_than_the_longest_packet(kind, chunks):
    reader = PacketReader(kind)
    lies = b"\xff\xff\x01\xfe" * 1000, b"\xff\xff\xfd\x00\x01\xff\x03\x03" * 1000
    for chunk in [*chunks, b"\xff" * 10_000, *lies]:
        fed(reader, chunk)
        assert reader.pending < (259 if kind is Packet1 else 1024)
