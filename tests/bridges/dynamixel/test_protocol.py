import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.bridges.dynamixel.protocol import (
    BROADCAST,
    REGISTERS,
    ControlTable,
    Error,
    Instruction,
    Packet,
    PacketReader,
    RefusedError,
)

packets = st.builds(
    Packet,
    st.integers(0, BROADCAST),
    st.integers(0, 255),
    st.binary(max_size=253),
)


def fed(reader, data, time=0.0):
    return list(reader.feed(data, time))


# Packets.


@pytest.mark.parametrize(
    ("packet", "wire"),
    [
        # The e-manual's own examples, "Protocol 1.0".
        (Packet(1, Instruction.PING), "ff ff 01 02 01 fb"),
        (Packet(1, Instruction.READ, b"\x2b\x01"), "ff ff 01 04 02 2b 01 cc"),
        (Packet(BROADCAST, Instruction.WRITE, b"\x03\x01"), "ff ff fe 04 03 03 01 f6"),
        (Packet(1, Error.OVERLOAD | Error.OVERHEATING), "ff ff 01 02 24 d8"),
    ],
)
def test_packets_are_those_of_the_manual(packet, wire):
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
def test_a_packet_is_found_after_any_garbage_and_a_pause(garbage, packet):
    reader = PacketReader()
    fed(reader, garbage, 0.0)
    assert fed(reader, packet.encode(), 0.2) == [packet]


@given(st.binary(), packets)
def test_a_packet_is_found_at_once_after_what_cannot_begin_one(garbage, packet):
    garbage = garbage.replace(b"\xff", b"")
    reader = PacketReader()
    assert fed(reader, garbage + packet.encode()) == [packet]
    assert reader.dropped == len(garbage)


def test_a_packet_is_found_within_one_that_is_broken_off():
    read = Packet(1, Instruction.READ, b"\x24\x02")
    broken, *rest = fed(PacketReader(), b"\xff\xff\x01\x05\x03" + read.encode())
    assert not broken.intact
    assert rest == [read]


@given(packets, st.integers(0, 258), st.integers(1, 255))
def test_a_changed_byte_does_not_pass(packet, at, change):
    wire = bytearray(packet.encode())
    wire[2 + at % (len(wire) - 2)] ^= change
    found = fed(PacketReader(), bytes(wire) + bytes(300))
    assert all(not p.intact for p in found if p.id == packet.id)


@given(st.lists(st.binary(max_size=2000), max_size=5))
def test_nothing_grows(chunks):
    reader = PacketReader()
    for chunk in [*chunks, b"\xff" * 10_000, b"\xff\xff\x01\xfe" * 1000]:
        fed(reader, chunk)
    assert len(reader._buffer) < 259


# Registers.


def test_registers_do_not_overlap():
    for one, next_ in itertools.pairwise(REGISTERS):
        assert one.address + one.size <= next_.address


@given(st.data())
def test_what_is_written_is_read(data):
    table = ControlTable()
    writable = [r for r in REGISTERS if r.limits and "angle" not in r.name]
    register = data.draw(st.sampled_from(writable))
    table["cw_angle_limit"] = table["ccw_angle_limit"] = 4095
    value = data.draw(st.integers(*register.limits))
    raw = value.to_bytes(register.size, "little", signed=register.signed)
    assert table.write(register.address, raw) == {register.name}
    assert table[register.name] == value
    assert table.read(register.address, register.size) == raw


@given(st.integers(0, 255), st.binary(min_size=1, max_size=100))
def test_a_write_is_whole_or_nothing(address, data):
    table = ControlTable()
    before = table.read(0, 74)
    try:
        table.write(address, data)
    except RefusedError:
        assert table.read(0, 74) == before
    else:
        assert table.read(address, len(data)) == data
        assert len(table.read(0, 74)) == 74


@pytest.mark.parametrize(
    ("address", "data", "error", "words"),
    [
        (0, "01", Error.RANGE, "model_number is read only"),
        (36, "01", Error.RANGE, "present_position is read only"),
        (73, "00 00", Error.RANGE, "where nothing is"),
        (60, "00", Error.RANGE, "where nothing is"),
        (34, "00 04", Error.RANGE, "torque_limit 1024; allowed are 0 to 1023"),
        (8, "00 00", Error.RANGE, "endless turning"),
        (30, "00 10", Error.ANGLE_LIMIT, "goal_position 4096; allowed are 0 to 4095"),
    ],
)
def test_what_is_refused(address, data, error, words):
    with pytest.raises(RefusedError, match=words) as refused:
        ControlTable().write(address, bytes.fromhex(data))
    assert refused.value.error == error


def test_a_locked_eeprom_stays_as_it_is():
    table = ControlTable()
    table.write(47, b"\x01")
    with pytest.raises(RefusedError, match="locked"):
        table.write(20, b"\x00\x00")
    table.write(34, b"\x64\x00")  # not in it


def test_reading_ends_where_the_table_does():
    assert ControlTable().read(0, 2) == (310).to_bytes(2, "little")
    with pytest.raises(RefusedError) as refused:
        ControlTable().read(70, 5)
    assert refused.value.error == Error.RANGE
