import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.bridges.dynamixel.protocol import (
    BROADCAST,
    Instruction,
    PacketReader,
    Refusal,
)
from drake_srg.bridges.dynamixel.protocol2 import ERRORS, FastStatus, Packet2


def fed(data):
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
def test_packets_match_the_manual_s_examples(number, code, parameters, end):
    parameters = bytes.fromhex(parameters)
    packet = Packet2(number, code, parameters)
    length = len(parameters) + 3
    wire = bytes([0xFF, 0xFF, 0xFD, 0, number, length, 0, code, *parameters])
    assert packet.encode() == wire + bytes.fromhex(end)
    assert fed(packet.encode()) == [packet]


@given(st.lists(st.sampled_from(b"\xff\xfd"), max_size=80).map(bytes))
def test_no_header_appears_within_a_packet(parameters):
    packet = Packet2(1, Instruction.WRITE, parameters)
    wire = packet.encode()
    assert not re.search(b"\xff\xff\xfd(?!\xfd)", wire[7:-2])
    assert fed(wire) == [packet]


def test_the_length_counts_inserted_bytes():
    wire = Packet2(1, Instruction.WRITE, b"\xff\xff\xfd").encode()
    assert wire[5:7] == b"\x07\x00"
    assert wire[7:-2] == b"\x03\xff\xff\xfd\xfd"


def test_data_without_inserted_bytes_are_understood():
    # As dynamixel-sdk 4.1.0 sends them.
    packet = FastStatus(1, Instruction.WRITE, b"\x74\x00\xff\xff\xfd\xff")
    (found,) = fed(packet.encode())
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
    assert fed(bytes.fromhex(start) + ping.encode()) == [ping]


def test_every_refusal_has_an_error():
    assert ERRORS.keys() == set(Refusal)
