"""Control tables."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.robot.serve.dynamixel.protocol import Refusal, RefusedError
from drake_srg.robot.serve.dynamixel.registers import (
    ControlTable1,
    ControlTable2,
    Mode,
    encode_directed,
)

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
def test_an_invalid_write_is_refused_by_protocol_1(address, data, kind, words):
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


RPM = math.tau / 60  # rad/s


@pytest.fixture
def table():
    return ControlTable2()


def refused(table, address, data):
    with pytest.raises(RefusedError) as refusal:
        table.write(address, bytes.fromhex(data))
    return refusal.value.kind


@pytest.mark.parametrize(
    ("address", "data", "kind"),
    [
        (0, "01 00", Refusal.ACCESS),  # read only
        (132, "01 00 00 00", Refusal.ACCESS),
        (147, "00", Refusal.ACCESS),  # no register there
        (65, "01 00", Refusal.ACCESS),  # nor behind this one
        (660, "00 00 00", Refusal.ACCESS),
        (116, "00 00", Refusal.LENGTH),
        (117, "00 00 00", Refusal.LENGTH),
        (11, "02", Refusal.RANGE),  # no such mode
        (10, "02", Refusal.RANGE),
        (13, "01", Refusal.RANGE),  # it stays with Protocol 2.0
        (168, "3f 00", Refusal.RANGE),  # an EEPROM address
        (116, "00 10 00 00", Refusal.LIMIT),  # 4096
        (104, "b4 01 00 00", Refusal.LIMIT),  # 436
    ],
)
def test_an_invalid_write_is_refused(table, address, data, kind):
    before = table.read(0, table.size)
    assert refused(table, address, data) is kind
    assert table.read(0, table.size) == before


@pytest.mark.parametrize(
    ("limit", "goal", "address", "data"),
    [("current_limit", 100, 102, "9b ff"), ("pwm_limit", 100, 100, "65 00")],
)
def test_limits_apply_to_goals_of_both_signs(table, limit, goal, address, data):
    table[limit] = goal
    assert refused(table, address, data) is Refusal.LIMIT
    table.write(address, goal.to_bytes(2, "little"))
    table.write(address, (-goal).to_bytes(2, "little", signed=True))


def test_position_limits_apply_in_position_mode_only(table):
    table.write(52, (1000).to_bytes(4, "little"))
    assert refused(table, 116, "e7 03 00 00") is Refusal.LIMIT
    for mode in (Mode.EXTENDED_POSITION, Mode.CURRENT_BASED_POSITION):
        table["operating_mode"] = mode
        table.write(116, (-20000).to_bytes(4, "little", signed=True))
    assert refused(table, 116, "00 00 10 00") is Refusal.RANGE


def test_the_eeprom_is_locked_while_torque_is_on(table):
    table.write(64, b"\x01")
    assert refused(table, 11, "05") is Refusal.ACCESS
    table.write(65, b"\x01")
    table.write(64, b"\x00")
    table.write(11, b"\x05")
    assert table.mode is Mode.CURRENT_BASED_POSITION


@pytest.mark.parametrize(("addresses", "data"), [(168, 224), (578, 634)])
def test_indirect_data_stand_for_other_registers(table, addresses, data):
    # The temperature, then the four bytes of the goal position.
    for k, target in enumerate([146, 116, 117, 118, 119]):
        table.write(addresses + 2 * k, target.to_bytes(2, "little"))
    table["present_temperature"] = 31
    assert table.write(data + 1, b"\x00\x04\x00\x00") == {"goal_position"}
    assert table["goal_position"] == 1024
    assert table.read(data, 5) == b"\x1f\x00\x04\x00\x00"
    assert refused(table, data, "00") is Refusal.ACCESS  # like the temperature itself
    assert refused(table, data + 1, "00 04") is Refusal.LENGTH


def test_indirect_data_store_values_of_their_own(table):
    table.write(224, b"\x07")
    assert table.read(224, 2) == b"\x07\x00"


@pytest.mark.parametrize(
    ("offset", "mode", "counts"),
    [(1024, 3, 1024), (-1025, 3, 0), (-1025, 4, -1025), (5000, 5, 5000)],
)
def test_position_mode_ignores_large_homing_offsets(table, offset, mode, counts):
    table["homing_offset"], table["operating_mode"] = offset, mode
    assert table.offset == counts


def test_no_profile_velocity_means_no_profile(table):
    table["profile_acceleration"] = 10
    assert table.profile(1.0) == (math.inf, math.inf)


def test_a_profile_is_limited_by_velocity(table):
    table["profile_velocity"] = 100
    assert table.profile(1.0) == (pytest.approx(22.9 * RPM), math.inf)
    table["profile_acceleration"] = 10
    assert table.profile(1.0)[1] == pytest.approx(2145.77 * RPM / 60)
    table["velocity_limit"], table["acceleration_limit"] = 50, 5
    limited = table.profile(1.0)
    assert limited == pytest.approx((11.45 * RPM, 1072.885 * RPM / 60))


def test_a_profile_may_have_a_duration(table):
    table["drive_mode"] = 4
    table["profile_velocity"], table["profile_acceleration"] = 2000, 500  # ms
    velocity, acceleration = table.profile(-3.0)
    assert velocity == pytest.approx(2.0)
    assert acceleration == pytest.approx(4.0)
    # The ramps take half of the duration each at most.
    table["profile_acceleration"] = 5000
    assert table.profile(3.0) == pytest.approx((3.0, 3.0))
    table["profile_acceleration"] = 0
    assert table.profile(3.0) == (1.5, math.inf)
