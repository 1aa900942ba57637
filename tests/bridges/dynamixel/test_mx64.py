import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.bridges.dynamixel.mx64 import Mx64
from drake_srg.bridges.dynamixel.protocol import (
    BROADCAST,
    REGISTERS,
    Error,
    Instruction,
    Packet,
    PacketReader,
)
from drake_srg.gripper.motor_temperature import MotorTemperatureConfig
from drake_srg.gripper.tendon import TendonDriveConfig

DRIVE = TendonDriveConfig()
ADDRESS = {register.name: register for register in REGISTERS}
COUNT = math.tau / 4096  # rad


class Servo(Mx64):
    """With the registers that a master writes and reads, and words that it hears."""

    def __init__(self, **heat):
        self.heard = []
        heat = MotorTemperatureConfig(**heat)
        super().__init__(DRIVE, heat, lambda kind, words: self.heard.append(kind))
        self.now = 0.0

    def send(self, code, parameters=b"", number=1):
        replies = self.answer(Packet(number, code, bytes(parameters)))
        return list(PacketReader().feed(replies, 0.0))

    def write(self, name, value, code=Instruction.WRITE):
        register = ADDRESS[name]
        value &= (1 << 8 * register.size) - 1
        data = value.to_bytes(register.size, "little")
        (status,) = self.send(code, [register.address, *data])
        return Error(status.code)

    def read(self, name):
        register = ADDRESS[name]
        (status,) = self.send(Instruction.READ, [register.address, register.size])
        return int.from_bytes(status.parameters, "little", signed=register.signed)

    def moves(self, angle=0.0, speed=0.0, pwm=0.0, temperature=25.0, lasting=0.005):
        for _ in range(round(lasting / 0.005)):
            self.now += 0.005
            self.sense(self.now, angle, speed, pwm, temperature)


@pytest.fixture
def servo():
    return Servo()


# As sensed.


def test_closing_lowers_the_position_as_sakes_zero_asks(servo):
    servo.moves(angle=0.0)
    is_open = servo.read("present_position")
    servo.moves(angle=2500 * COUNT)  # SAKE: 2500 counts from open to closed
    assert servo.read("present_position") == is_open - 2500
    # Both within a turn, so that joint mode reaches them.
    assert is_open < 4096


def test_in_multi_turn_mode_the_position_has_a_sign_an_offset_and_a_divider(servo):
    servo.moves(angle=2 * math.tau)
    assert servo.read("present_position") == 3298  # two turns on, in joint mode
    servo.send(Instruction.WRITE, [6, 0xFF, 0x0F, 0xFF, 0x0F])
    servo.moves(angle=2 * math.tau)
    assert servo.read("present_position") == 3298 - 8192
    servo.write("resolution_divider", 2)
    servo.write("multi_turn_offset", -100)
    servo.moves(angle=2 * math.tau)
    assert servo.read("present_position") == (3298 - 8192) // 2 - 100


def test_speeds_and_loads_of_closing_are_clockwise(servo):
    # 0.114 rpm and 1/1023 of full supply; full PWM is 800 of these.
    servo.moves(speed=10 * 0.114 * math.tau / 60, pwm=0.5)
    assert servo.read("present_speed") == 1024 + 10
    assert servo.read("present_load") == 1024 + 400
    assert servo.read("moving") == 1
    servo.moves(speed=-0.5 * math.tau / 60, pwm=-0.5)
    assert servo.read("present_speed") == 4
    assert servo.read("present_load") == 400
    servo.moves()
    assert [servo.read(f"present_{x}") for x in ("speed", "load")] == [0, 0]
    assert servo.read("moving") == 0


def test_voltage_temperature_and_current(servo):
    servo.moves(pwm=0.5, temperature=31.6)
    assert servo.read("present_voltage") == 120
    assert servo.read("present_temperature") == 32
    # 400 of 1023 of 4.1 A, in 4.5 mA, counted down as it winds clockwise.
    assert servo.read("current") == 2048 - round(400 / 1023 * 4.1 / 4.5e-3)


def test_currents_and_voltage_are_the_motors():
    servo = Servo(stall_current=8.2, supply_voltage=14.8)
    servo.moves(pwm=0.5)
    assert servo.read("present_voltage") == 148
    assert servo.read("current") == 2048 - round(400 / 1023 * 8.2 / 4.5e-3)
    servo.write("torque_control_mode", 1)
    servo.write("goal_torque", 1024 + 100)
    assert servo.command().torque == pytest.approx(0.45 / 8.2 * 1023 / 800)


# Commands.


def test_until_a_master_moves_the_motor_it_is_others_to_command(servo):
    for name in ("led", "torque_limit", "goal_torque", "moving_speed", "lock"):
        servo.write(name, 1)
        assert servo.command() is None
    servo.write("torque_enable", 0)
    assert servo.command() is not None


def test_a_goal_position_turns_the_torque_on(servo):
    servo.moves(angle=1.0)
    servo.write("goal_position", 3298 - 1000)
    assert servo.read("torque_enable") == 1
    command = servo.command()
    assert command.position == pytest.approx(1000 * COUNT)
    assert math.isnan(command.torque)
    assert command.limit == 1.0  # 1023 is beyond the 800 that the drive gives


@given(
    st.integers(-28672, 28672),
    st.integers(-24576, 24576),
    st.integers(1, 4),
)
def test_where_it_is_told_to_go_it_says_that_it_is(goal, offset, divider):
    servo = Servo()
    servo.send(Instruction.WRITE, [6, 0xFF, 0x0F, 0xFF, 0x0F])
    servo.write("multi_turn_offset", offset)
    servo.write("resolution_divider", divider)
    servo.write("goal_position", goal)
    servo.moves(angle=servo.command().position)
    assert servo.read("present_position") == goal


def test_torque_enabled_without_a_goal_stays_where_it_is(servo):
    servo.moves(angle=0.7)
    servo.write("torque_enable", 1)
    assert servo.command().position == pytest.approx(0.7, abs=COUNT)


def test_without_torque_the_motor_is_free(servo):
    servo.write("goal_position", 2000)
    servo.write("torque_enable", 0)
    assert math.isnan(servo.command().position)
    assert servo.command().torque == 0.0


@pytest.mark.parametrize(("goal", "sign"), [(1024 + 100, 1), (100, -1), (1024, 0)])
def test_torque_control_winds_clockwise(servo, goal, sign):
    servo.write("torque_enable", 0)  # as SAKE's driver has it
    servo.write("torque_control_mode", 1)
    servo.write("goal_torque", goal)
    # 100 times 4.5 mA of the 4.1 A at stall; full PWM has 800 of 1023 of that.
    expected = sign * 0.45 / 4.1 * 1023 / 800
    assert servo.command().torque == pytest.approx(expected)
    assert math.isnan(servo.command().position)


def test_released_after_calibration_the_motor_is_free(servo):
    servo.write("torque_enable", 0)
    servo.write("torque_control_mode", 1)
    servo.write("goal_torque", 1024 + 100)
    servo.write("torque_control_mode", 0)
    assert servo.command().torque == 0.0


@pytest.mark.parametrize(("register", "kappa"), [(0, 0.0), (104, 0.13), (800, 1.0)])
def test_the_torque_limit_counts_of_the_stall_torque(servo, register, kappa):
    servo.write("goal_position", 2000)
    servo.write("torque_limit", register)
    assert servo.command().limit == pytest.approx(kappa)


def test_a_moving_speed_makes_the_goal_approach(servo):
    servo.moves(angle=0.0)
    servo.write("moving_speed", 100)
    servo.write("goal_position", 3298 - 2048)
    speed = 100 * 0.114 * math.tau / 60
    assert servo.command().position == pytest.approx(0.0)
    servo.moves(lasting=1.0)
    assert servo.command().position == pytest.approx(speed)
    servo.moves(lasting=3.0)
    assert servo.command().position == pytest.approx(math.pi)


@pytest.mark.parametrize(
    ("name", "value"),
    [("goal_position", 2000), ("torque_enable", 0), ("goal_torque", 1024 + 100)],
)
def test_released_it_commands_nothing_until_it_is_told_to_move(servo, name, value):
    servo.write("torque_control_mode", 1)
    servo.release()
    assert servo.command() is None
    servo.write("torque_limit", 104)
    assert servo.command() is None
    servo.write(name, value)
    assert servo.command() is not None


def test_a_profile_begins_where_somebody_else_has_left_the_motor(servo):
    servo.write("moving_speed", 100)
    servo.write("goal_position", 1000)
    servo.moves(lasting=1.0)
    servo.release()
    servo.moves(angle=2.0, lasting=1.0)
    servo.write("goal_position", 1000)
    assert servo.command().position == pytest.approx(2.0)


# What protects it.


def overload(servo, lasting=10.1):
    servo.write("torque_limit", 500)
    servo.write("goal_position", 1000)
    servo.moves(pwm=500 / 800, lasting=lasting)
    return servo.read("torque_limit"), Error(servo.send(Instruction.PING)[0].code)


def test_overload_shuts_down_and_a_torque_limit_recovers(servo):
    assert overload(servo) == (0, Error.OVERLOAD)
    assert servo.read("torque_enable") == 0
    assert servo.command().torque == servo.command().limit == 0.0
    assert servo.heard == ["overload"]
    # What check_overload_and_recover() of SAKE's driver sends, and looks at.
    servo.write("goal_torque", 0)
    servo.write("torque_control_mode", 0)
    assert servo.write("torque_limit", 500) == Error(0)
    servo.moves()
    assert servo.write("led", 0) == Error(0)
    # Off it stays until somebody turns the torque on.
    assert servo.command().torque == 0.0
    servo.write("goal_position", 3000)
    assert math.isfinite(servo.command().position)


def test_a_moments_load_is_none_too_many(servo):
    assert overload(servo, lasting=9.9) == (500, Error(0))
    servo.moves(pwm=0.0)
    servo.moves(pwm=500 / 800, lasting=9.9)
    assert servo.read("torque_limit") == 500


def test_what_sakes_driver_holds_with_may_last(servo):
    servo.write("torque_control_mode", 1)
    servo.write("torque_limit", 104)
    servo.write("goal_torque", 1024 + 104)
    servo.moves(pwm=104 / 800, lasting=60.0)
    assert servo.read("torque_limit") == 104


def test_a_load_within_the_limit_is_no_overload(servo):
    servo.write("goal_position", 1000)
    servo.moves(pwm=0.9, lasting=30.0)
    assert servo.read("torque_limit") == 1023


def test_what_others_load_the_motor_with_is_not_held_against_it(servo):
    servo.write("goal_position", 1000)
    servo.write("torque_limit", 104)
    servo.release()
    servo.moves(pwm=1.0 / 3.0, lasting=30.0)
    assert servo.read("torque_limit") == 104


def test_what_shutdown_does_not_name_is_told_alone(servo):
    servo.write("shutdown", 0)
    assert overload(servo) == (500, Error.OVERLOAD)


def test_overheating_shuts_down_until_it_is_cold(servo):
    servo.write("goal_position", 1000)
    servo.moves(temperature=80.0)
    assert servo.write("led", 1) == Error(0)
    servo.moves(temperature=81.0)
    assert servo.write("torque_limit", 500) == Error.OVERHEATING
    servo.moves(temperature=81.0)
    assert servo.command().limit == 0.0
    servo.moves(temperature=79.0)
    assert servo.write("torque_limit", 500) == Error(0)
    assert servo.heard == ["overheating"] * 2


# Instructions.


def test_it_answers_to_its_own_number_alone(servo):
    assert servo.send(Instruction.PING) == [Packet(1, 0)]
    assert servo.send(Instruction.PING, number=2) == []
    servo.write("id", 7)
    assert servo.send(Instruction.PING) == []
    assert servo.send(Instruction.PING, number=7) == [Packet(7, 0)]


def test_it_obeys_all_that_is_for_everybody_and_says_nothing(servo):
    register = ADDRESS["led"].address
    assert servo.send(Instruction.WRITE, [register, 1], number=BROADCAST) == []
    assert servo.read("led") == 1
    assert servo.send(Instruction.READ, [3, 1], number=BROADCAST) == []


@pytest.mark.parametrize(("level", "replies"), [(0, 0), (1, 1), (2, 2)])
def test_the_status_return_level_says_what_is_answered(servo, level, replies):
    assert servo.write("status_return_level", level) == Error(0)
    assert len(servo.send(Instruction.PING)) == 1
    answers = servo.send(Instruction.READ, [3, 1])
    assert len(answers + servo.send(Instruction.WRITE, [25, 1])) == replies


def test_registered_writes_wait_for_the_action(servo):
    servo.write("led", 1, code=Instruction.REG_WRITE)
    assert (servo.read("led"), servo.read("registered")) == (0, 1)
    assert servo.send(Instruction.ACTION, number=BROADCAST) == []
    assert (servo.read("led"), servo.read("registered")) == (1, 0)
    (status,) = servo.send(Instruction.ACTION)
    assert status.code == Error.INSTRUCTION


def test_of_a_sync_write_it_takes_its_own(servo):
    blocks = [2, 0x10, 0x00, 1, 0x20, 0x01, 3, 0x30, 0x00]
    assert servo.send(Instruction.SYNC_WRITE, [32, 2, *blocks], BROADCAST) == []
    assert servo.read("moving_speed") == 0x120


def test_of_a_bulk_read_it_answers_its_own(servo):
    others = [0, 2, 5, 30, 2, 1, 0]
    (status,) = servo.send(Instruction.BULK_READ, others, BROADCAST)
    assert status.parameters == (310).to_bytes(2, "little")
    assert servo.send(Instruction.BULK_READ, others[:4], BROADCAST) == []


@pytest.mark.parametrize(
    ("code", "parameters", "error"),
    [
        (Instruction.FACTORY_RESET, b"", Error.INSTRUCTION),
        (0x77, b"", Error.INSTRUCTION),
        (Instruction.READ, b"\x03", Error.INSTRUCTION),
        (Instruction.WRITE, b"\x03", Error.INSTRUCTION),
        (Instruction.READ, b"\x00\xff", Error.RANGE),
        (Instruction.WRITE, b"\x24\x00\x00", Error.RANGE),
        (Instruction.WRITE, b"\x1e\x00\x10", Error.ANGLE_LIMIT),
    ],
)
def test_faults_are_told(servo, code, parameters, error):
    (status,) = servo.send(code, parameters)
    assert status.code == error
    assert status.parameters == b""
    assert servo.heard == [error.name.lower().replace("_", " ")]


def test_a_wrong_checksum_is_told(servo):
    reply = servo.answer(Packet(1, Instruction.PING, intact=False))
    assert reply == Packet(1, Error.CHECKSUM).encode()
    assert servo.answer(Packet(9, Instruction.PING, intact=False)) == b""


@given(st.integers(0, 255), st.integers(0, 255), st.binary(max_size=253))
def test_no_packet_upsets_it(number, code, parameters):
    servo = Servo()
    servo.answer(Packet(number, code, parameters))
    servo.moves(angle=1.0, speed=1.0, pwm=0.5)
    command = servo.command()
    if command:
        assert math.isnan(command.position) != math.isnan(command.torque)
        assert 0.0 <= command.limit <= 1.0
