import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.bridges.dynamixel.protocol import (
    BROADCAST,
    Error,
    Instruction,
    Packet,
    PacketReader,
)

packets = st.builds(
    Packet,
    st.integers(0, BROADCAST),
    st.integers(0, 255),
    st.binary(max_size=253),
)


def fed(reader, data, time=0.0):
    return list(reader.feed(data, time))


@pytest.mark.parametrize(
    ("packet", "wire"),
    [
        # Examples of the e-manual, "Protocol 1.0".
        (Packet(1, Instruction.PING), "ff ff 01 02 01 fb"),
        (Packet(1, Instruction.READ, b"\x2b\x01"), "ff ff 01 04 02 2b 01 cc"),
        (Packet(BROADCAST, Instruction.WRITE, b"\x03\x01"), "ff ff fe 04 03 03 01 f6"),
        (Packet(1, Error.OVERLOAD | Error.OVERHEATING), "ff ff 01 02 24 d8"),
    ],
)
def test_packets_match_the_manual_s_examples(packet, wire):
    assert packet.encode() == bytes.fromhex(wire)
    assert fed(PacketReader(), packet.encode()) == [packet]


@given(st.lists(packets, max_size=4), st.lists(st.integers(0, 400)))
def test_a_stream_may_be_cut_anywhere(sent, cuts):
    stream = b"".join(packet.encode() for packet in sent)
    ends = sorted({min(cut, len(stream)) for cut in cuts} | {len(stream)})
    reader, received, start = PacketReader(), [], 0
    for end in ends:
        received += fed(reader, stream[start:end])
        start = end
    assert received == sent
    assert reader.dropped == 0


@given(st.binary(), packets)
def test_a_packet_is_found_after_garbage_and_a_pause(garbage, packet):
    reader = PacketReader()
    fed(reader, garbage, 0.0)
    assert fed(reader, packet.encode(), 0.2) == [packet]


@given(st.binary(), packets)
def test_a_packet_is_found_at_once_after_bytes_that_cannot_begin_one(garbage, packet):
    garbage = garbage.replace(b"\xff", b"")
    reader = PacketReader()
    assert fed(reader, garbage + packet.encode()) == [packet]
    assert reader.dropped == len(garbage)


def test_a_packet_is_found_within_a_broken_one():
    read = Packet(1, Instruction.READ, b"\x24\x02")
    broken, *rest = fed(PacketReader(), b"\xff\xff\x01\x05\x03" + read.encode())
    assert not broken.intact
    assert rest == [read]


@given(packets, st.integers(0, 258), st.integers(1, 255))
def test_a_changed_byte_is_detected(packet, at, change):
    wire = bytearray(packet.encode())
    wire[2 + at % (len(wire) - 2)] ^= change
    found = fed(PacketReader(), bytes(wire) + bytes(300))
    assert all(not p.intact for p in found if p.id == packet.id)


@pytest.mark.slow
@given(st.lists(st.binary(max_size=2000), max_size=5))
def test_the_buffer_stays_shorter_than_the_longest_packet(chunks):
    reader = PacketReader()
    for chunk in [*chunks, b"\xff" * 10_000, b"\xff\xff\x01\xfe" * 1000]:
        fed(reader, chunk)
        assert reader.pending < 259
