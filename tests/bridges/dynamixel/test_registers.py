"""Control tables, the same in both protocols."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.bridges.dynamixel.protocol import Refusal, RefusedError
from drake_srg.bridges.dynamixel.registers1 import ControlTable1
from drake_srg.bridges.dynamixel.registers2 import ControlTable2

TABLES = pytest.mark.parametrize("kind", [ControlTable1, ControlTable2])


@TABLES
def test_registers_do_not_overlap(kind):
    for one, next_ in itertools.pairwise(
        sorted(kind.registers, key=lambda r: r.address)
    ):
        assert one.address + one.size <= next_.address
    assert next_.address + next_.size == kind.size
    assert len({register.name for register in kind.registers}) == len(kind.registers)


@TABLES
def test_defaults_are_valid(kind):
    table = kind()
    for register in kind.registers:
        if register.limits:
            register.check(table[register.name], "")


@TABLES
@given(data=st.data())
def test_a_written_value_is_read_back(kind, data):
    table = kind()
    writable = [r for r in kind.registers if r.limits and "angle" not in r.name]
    register = data.draw(st.sampled_from(writable))
    if kind is ControlTable1:
        table["cw_angle_limit"] = table["ccw_angle_limit"] = 4095
    else:
        table["operating_mode"], table["velocity_limit"] = 4, 1023
    few = register.values or register.limits
    value = data.draw(
        st.sampled_from(few)
        if register.values
        else st.sampled_from(few) | st.integers(*few)
    )
    raw = value.to_bytes(register.size, "little", signed=register.signed)
    assert table.write(register.address, raw) == {register.name}
    assert table[register.name] == value
    if "address" not in register.name:
        assert table.read(register.address, register.size) == raw


@TABLES
@given(st.integers(0, 700), st.binary(min_size=1, max_size=100))
def test_a_write_changes_everything_or_nothing(kind, address, data):
    table = kind()
    before = table.read(0, kind.size)
    try:
        table.write(address, data)
    except RefusedError:
        assert table.read(0, kind.size) == before
    else:
        assert table.read(address, len(data)) == data
        assert len(table.read(0, kind.size)) == kind.size


@TABLES
def test_a_read_beyond_the_table_is_refused(kind):
    assert kind().read(0, 1) == bytes([kind()["model_number"] % 256])
    with pytest.raises(RefusedError) as refused:
        kind().read(kind.size - 4, 5)
    assert refused.value.kind is Refusal.ACCESS
