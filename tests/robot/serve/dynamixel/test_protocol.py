"""Packets, and streams of them."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.robot.serve.dynamixel.protocol import (
    BROADCAST,
    Error1,
    FastStatus,
    Fault,
    Instruction,
    Packet1,
    Packet2,
    PacketReader,
    Refusal,
)

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


@KINDS
@pytest.mark.parametrize("refused", [None, *Refusal])
@pytest.mark.parametrize("fault", [Fault(0), Fault.OVERLOAD])
def test_a_master_reads_what_a_servo_answers(kind, refused, fault):
    answer = kind.answer(1, Instruction.READ, fault, refused, b"ab")
    (packet,) = fed(PacketReader(kind), answer.encode())
    status = packet.status
    assert packet.id == 1 and status.data == b"ab"
    assert bool(status.fault) is bool(fault)
    if kind is Packet2:  # Protocol 1.0 has one error for several refusals
        assert status.refusal is refused
    else:
        assert (status.refusal is None) is (refused is None)


@KINDS
def test_a_servo_reads_what_a_master_asks_of_several(kind):
    packet = kind.group_read([3, 1], 30, 4)
    (packet,) = fed(PacketReader(kind), packet.encode())
    assert packet.id == BROADCAST
    assert packet.asked == [(3, 30, 4), (1, 30, 4)]
    assert kind(1, Instruction.READ, b"\x1e\x00\x04\x00").asked == []


@KINDS
def test_a_broken_packet_has_no_status(kind):
    answer = kind.answer(1, Instruction.READ, Fault(0), None, b"ab").encode()
    broken = answer[:-1] + bytes([answer[-1] ^ 1])
    assert kind.decode(broken).status is None


@pytest.mark.parametrize(
    ("packet", "wire"),
    [
        # Examples of the e-manual, "Protocol 1.0".
        (Packet1(1, Instruction.PING), "ff ff 01 02 01 fb"),
        (Packet1(1, Instruction.READ, b"\x2b\x01"), "ff ff 01 04 02 2b 01 cc"),
        (Packet1(BROADCAST, Instruction.WRITE, b"\x03\x01"), "ff ff fe 04 03 03 01 f6"),
        (Packet1(1, Error1.OVERLOAD | Error1.OVERHEATING), "ff ff 01 02 24 d8"),
    ],
)
def test_protocol_1_matches_the_manual_s_examples(packet, wire):
    assert packet.encode() == bytes.fromhex(wire)
    assert list(PacketReader(Packet1).feed(packet.encode(), 0.0)) == [packet]


def fed2(data):
    return list(PacketReader(Packet2).feed(data, 0.0))


@pytest.mark.parametrize(
    ("number", "code", "parameters", "end"),
    [
        # Examples of the e-manual, "Protocol 2.0".
        (1, Instruction.PING, "", "19 4e"),
        (BROADCAST, Instruction.PING, "", "31 42"),
        (1, Instruction.STATUS, "00 06 04 26", "65 5d"),
        (1, Instruction.READ, "84 00 04 00", "1d 15"),
        (1, Instruction.WRITE, "74 00 00 02 00 00", "ca 89"),
        (1, Instruction.REG_WRITE, "68 00 c8 00 00 00", "ae 8e"),
        (1, Instruction.ACTION, "", "02 ce"),
        (1, Instruction.FACTORY_RESET, "01", "a1 e6"),
        (1, Instruction.REBOOT, "", "2f 4e"),
        (1, Instruction.CLEAR, "01 44 58 4c 22", "b1 dc"),
        (BROADCAST, Instruction.SYNC_READ, "84 00 04 00 01 02", "ce fa"),
        (
            *(BROADCAST, Instruction.BULK_READ),
            *("01 90 00 02 00 02 92 00 01 00", "1a 05"),
        ),
        (
            *(BROADCAST, Instruction.BULK_WRITE),
            *("01 20 00 02 00 a0 00 02 1f 00 01 00 50", "b7 68"),
        ),
    ],
)
def test_protocol_2_matches_the_manual_s_examples(number, code, parameters, end):
    parameters = bytes.fromhex(parameters)
    packet = Packet2(number, code, parameters)
    length = len(parameters) + 3
    wire = bytes([0xFF, 0xFF, 0xFD, 0, number, length, 0, code, *parameters])
    assert packet.encode() == wire + bytes.fromhex(end)
    assert fed2(packet.encode()) == [packet]


@given(st.lists(st.sampled_from(b"\xff\xfd"), max_size=80).map(bytes))
def test_no_header_appears_within_a_packet(parameters):
    packet = Packet2(1, Instruction.WRITE, parameters)
    wire = packet.encode()
    assert not re.search(b"\xff\xff\xfd(?!\xfd)", wire[7:-2])
    assert fed2(wire) == [packet]


def test_data_without_inserted_bytes_are_understood():
    # As dynamixel-sdk 4.1.0 sends them.
    packet = FastStatus(1, Instruction.WRITE, b"\x74\x00\xff\xff\xfd\xff")
    (found,) = fed2(packet.encode())
    assert found.intact and found.parameters == packet.parameters


@pytest.mark.parametrize(
    "start",
    [
        "ff ff fd fd 01 03 00",  # reserved byte
        "ff ff fd 00 fd 03 00",  # IDs
        "ff ff fd 00 ff 03 00",
        "ff ff fd 00 01 02 00",  # lengths
        "ff ff fd 00 01 fa 03",
    ],
)
def test_an_impossible_start_delays_nothing(start):
    ping = Packet2(1, Instruction.PING)
    assert fed2(bytes.fromhex(start) + ping.encode()) == [ping]
