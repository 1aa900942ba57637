import pytest

from drake_srg.bridges.dynamixel.protocol import (
    BROADCAST,
    Instruction,
    PacketReader,
    Refusal,
)
from drake_srg.bridges.dynamixel.protocol1 import ERRORS, Error, Packet1


@pytest.mark.parametrize(
    ("packet", "wire"),
    [
        # Examples of the e-manual, "Protocol 1.0".
        (Packet1(1, Instruction.PING), "ff ff 01 02 01 fb"),
        (Packet1(1, Instruction.READ, b"\x2b\x01"), "ff ff 01 04 02 2b 01 cc"),
        (Packet1(BROADCAST, Instruction.WRITE, b"\x03\x01"), "ff ff fe 04 03 03 01 f6"),
        (Packet1(1, Error.OVERLOAD | Error.OVERHEATING), "ff ff 01 02 24 d8"),
    ],
)
def test_packets_match_the_manual_s_examples(packet, wire):
    assert packet.encode() == bytes.fromhex(wire)
    assert list(PacketReader(Packet1).feed(packet.encode(), 0.0)) == [packet]


def test_every_refusal_has_an_error():
    assert ERRORS.keys() == set(Refusal)
