import pytest

from drake_srg.bridges.dynamixel.protocol import Refusal, RefusedError
from drake_srg.bridges.dynamixel.registers1 import ControlTable1, encode_directed


@pytest.mark.parametrize(
    ("address", "data", "kind", "words"),
    [
        (0, "01", Refusal.ACCESS, "model_number is read only"),
        (36, "01", Refusal.ACCESS, "present_position is read only"),
        (73, "00 00", Refusal.ACCESS, "no register there"),
        (60, "00", Refusal.ACCESS, "no register there"),
        (34, "00 04", Refusal.RANGE, "torque_limit must be 0 to 1023, got 1024"),
        (8, "00 00", Refusal.RANGE, "endless turning"),
        (30, "00 10", Refusal.LIMIT, "goal_position must be 0 to 4095, got 4096"),
    ],
)
def test_an_invalid_write_is_refused(address, data, kind, words):
    with pytest.raises(RefusedError, match=words) as refused:
        ControlTable1().write(address, bytes.fromhex(data))
    assert refused.value.kind is kind


def test_a_locked_eeprom_cannot_be_written():
    table = ControlTable1()
    table.write(47, b"\x01")
    with pytest.raises(RefusedError, match="locked"):
        table.write(20, b"\x00\x00")
    table.write(34, b"\x64\x00")  # in the RAM


@pytest.mark.parametrize(
    ("value", "code"),
    [
        (0.0, 0),
        (0.4, 0),
        (10.0, 1024 + 10),
        (-10.0, 10),
        (5000.0, 2047),
        (-5000.0, 1023),
    ],
)
def test_directed_values_have_a_clockwise_bit_and_saturate(value, code):
    assert encode_directed(value) == code
