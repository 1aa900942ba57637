import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.robot.serve.dynamixel.protocol import (
    BROADCAST,
    Error1,
    Instruction,
    Packet1,
)
from robot.serve.dynamixel.servo_with_master import ServoWithMaster


@pytest.fixture
def servo():
    return ServoWithMaster()


def test_it_answers_only_its_own_id(servo):
    assert servo.send(Instruction.PING) == [Packet1(1, 0)]
    assert servo.send(Instruction.PING, number=2) == []
    servo.write("id", 7)
    assert servo.send(Instruction.PING) == []
    assert servo.send(Instruction.PING, number=7) == [Packet1(7, 0)]


def test_it_obeys_broadcasts_without_a_reply(servo):
    register = servo.register["led"].address
    assert servo.send(Instruction.WRITE, [register, 1], number=BROADCAST) == []
    assert servo.read("led") == 1
    assert servo.send(Instruction.READ, [3, 1], number=BROADCAST) == []


@pytest.mark.parametrize(("level", "replies"), [(0, 0), (1, 1), (2, 2)])
def test_the_status_return_level_selects_replies(servo, level, replies):
    assert servo.write("status_return_level", level) == Error1(0)
    assert len(servo.send(Instruction.PING)) == 1
    answers = servo.send(Instruction.READ, [3, 1])
    assert len(answers + servo.send(Instruction.WRITE, [25, 1])) == replies


def test_a_registered_write_waits_for_the_action(servo):
    servo.write("led", 1, code=Instruction.REG_WRITE)
    assert (servo.read("led"), servo.read("registered")) == (0, 1)
    assert servo.send(Instruction.ACTION, number=BROADCAST) == []
    assert (servo.read("led"), servo.read("registered")) == (1, 0)
    (status,) = servo.send(Instruction.ACTION)
    assert status.code == Error1.INSTRUCTION


def test_it_takes_its_own_block_of_a_sync_write(servo):
    blocks = [2, 0x10, 0x00, 1, 0x20, 0x01, 3, 0x30, 0x00]
    assert servo.send(Instruction.SYNC_WRITE, [32, 2, *blocks], BROADCAST) == []
    assert servo.read("moving_speed") == 0x120


def test_it_answers_its_own_block_of_a_bulk_read(servo):
    others = [0, 2, 5, 30, 2, 1, 0]
    (status,) = servo.send(Instruction.BULK_READ, others, BROADCAST)
    assert status.parameters == (310).to_bytes(2, "little")
    assert servo.send(Instruction.BULK_READ, others[:4], BROADCAST) == []


@pytest.mark.parametrize(
    ("code", "parameters", "error"),
    [
        (Instruction.FACTORY_RESET, b"", Error1.INSTRUCTION),
        (0x77, b"", Error1.INSTRUCTION),
        (Instruction.READ, b"\x03", Error1.INSTRUCTION),
        (Instruction.WRITE, b"\x03", Error1.INSTRUCTION),
        (Instruction.READ, b"\x00\xff", Error1.RANGE),
        (Instruction.WRITE, b"\x24\x00\x00", Error1.RANGE),
        (Instruction.WRITE, b"\x1e\x00\x10", Error1.ANGLE_LIMIT),
    ],
)
def test_an_invalid_instruction_is_answered_by_an_error(servo, code, parameters, error):
    (status,) = servo.send(code, parameters)
    assert status.code == error
    assert status.parameters == b""
    assert len(servo.warned) == 1


def test_a_wrong_checksum_is_answered_with_an_error(servo):
    reply = servo.answer(Packet1(1, Instruction.PING, intact=False))
    assert reply == Packet1(1, Error1.CHECKSUM).encode()
    assert servo.answer(Packet1(9, Instruction.PING, intact=False)) == b""


@given(st.integers(0, 255), st.integers(0, 255), st.binary(max_size=253))
def test_any_packet_leaves_a_valid_command(number, code, parameters):
    servo = ServoWithMaster()
    servo.answer(Packet1(number, code, parameters))
    servo.move(angle=1.0, speed=1.0, pwm=0.5)
    command = servo.command()
    if command:
        assert math.isnan(command.position) != math.isnan(command.torque)
        assert 0.0 <= command.limit <= 1.0
