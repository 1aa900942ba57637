import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.bridges.dynamixel.protocol import Error, RefusedError
from drake_srg.bridges.dynamixel.registers import (
    REGISTERS,
    ControlTable,
    encode_directed,
)


def test_registers_do_not_overlap():
    for one, next_ in itertools.pairwise(REGISTERS):
        assert one.address + one.size <= next_.address


@given(st.data())
def test_a_written_value_is_read_back(data):
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
def test_a_write_changes_everything_or_nothing(address, data):
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
        (73, "00 00", Error.RANGE, "no register there"),
        (60, "00", Error.RANGE, "no register there"),
        (34, "00 04", Error.RANGE, "torque_limit must be 0 to 1023, got 1024"),
        (8, "00 00", Error.RANGE, "endless turning"),
        (30, "00 10", Error.ANGLE_LIMIT, "goal_position must be 0 to 4095, got 4096"),
    ],
)
def test_an_invalid_write_is_refused(address, data, error, words):
    with pytest.raises(RefusedError, match=words) as refused:
        ControlTable().write(address, bytes.fromhex(data))
    assert refused.value.error == error


def test_a_locked_eeprom_cannot_be_written():
    table = ControlTable()
    table.write(47, b"\x01")
    with pytest.raises(RefusedError, match="locked"):
        table.write(20, b"\x00\x00")
    table.write(34, b"\x64\x00")  # in the RAM


def test_a_read_beyond_the_table_is_refused():
    assert ControlTable().read(0, 2) == (310).to_bytes(2, "little")
    with pytest.raises(RefusedError) as refused:
        ControlTable().read(70, 5)
    assert refused.value.error == Error.RANGE


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
