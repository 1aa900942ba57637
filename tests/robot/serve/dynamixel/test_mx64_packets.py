"""The packets of an MX-64, with both protocols."""

import math
import random

import pytest

from drake_srg.robot.serve.dynamixel.protocol import (
    BROADCAST,
    Error1,
    Instruction,
    Packet2,
    Refusal,
)
from robot.serve.dynamixel.servo_with_master import ServoWithMaster, ServoWithMaster2

TWO = pytest.mark.parametrize("protocol", [2])


@pytest.fixture(params=[1, 2])
def protocol(request):
    return request.param


@pytest.fixture
def servo(protocol):
    return {1: ServoWithMaster, 2: ServoWithMaster2}[protocol]()


@pytest.fixture
def led(servo):
    """The address of a register of one byte."""
    return servo.register["led"].address


def words(*numbers):
    return b"".join(number.to_bytes(2, "little") for number in numbers)


def test_it_answers_only_its_own_id(servo):
    (pong,) = servo.send(Instruction.PING)
    assert (pong.id, servo.error(pong), servo.data(pong)) == (1, 0, servo.identity)
    assert servo.broadcast(Instruction.PING) == [pong]
    assert servo.send(Instruction.PING, number=2) == []
    servo.write("id", 7)
    assert servo.send(Instruction.PING) == []
    (pong,) = servo.send(Instruction.PING, number=7)
    assert pong.id == 7


def test_it_obeys_broadcasts_without_a_reply(servo, led):
    assert servo.broadcast(Instruction.WRITE, servo.words(led) + b"\x01") == []
    assert servo.read("led") == 1
    assert servo.broadcast(Instruction.READ, servo.words(led, 1)) == []


@pytest.mark.parametrize(("level", "replies"), [(0, 0), (1, 2), (2, 3)])
def test_the_status_return_level_selects_replies(servo, led, level, replies):
    assert servo.write("status_return_level", level) == 0
    assert len(servo.send(Instruction.PING)) == 1
    group = servo.table.packets.group_read([1], led, 1)
    sent = servo.send(Instruction.READ, servo.words(led, 1))
    sent += servo.broadcast(group.code, group.parameters)
    sent += servo.send(Instruction.WRITE, servo.words(led) + b"\x01")
    assert len(sent) == replies


def test_a_registered_write_waits_for_the_action(servo):
    servo.write("led", 1, code=Instruction.REG_WRITE)
    assert (servo.read("led"), servo.read("registered")) == (0, 1)
    assert servo.broadcast(Instruction.ACTION) == []
    assert (servo.read("led"), servo.read("registered")) == (1, 0)
    (status,) = servo.send(Instruction.ACTION)
    assert servo.error(status) == servo.errors.INSTRUCTION


@pytest.mark.parametrize(
    ("protocol", "code", "parameters", "data"),
    [
        (1, Instruction.BULK_READ, b"\0\2\5\x1e\2\1\0", words(310)),
        (2, Instruction.SYNC_READ, words(146, 1) + b"\2\1", b"\x19"),
        (2, Instruction.BULK_READ, b"\2\0\0\2\0\1\x92\0\1\0", b"\x19"),
    ],
)
def test_it_answers_its_part_of_a_group_read(servo, code, parameters, data):
    (status,) = servo.broadcast(code, parameters)
    assert (status.id, servo.error(status), servo.data(status)) == (1, 0, data)
    servo.write("id", 3)
    assert servo.broadcast(code, parameters) == []


@TWO
def test_a_group_read_beyond_the_table_is_an_error(servo):
    (status,) = servo.broadcast(Instruction.SYNC_READ, words(660, 4) + b"\x01")
    assert (servo.error(status), servo.data(status)) == (Refusal.ACCESS, b"")


@TWO
@pytest.mark.parametrize(
    ("code", "parameters"),
    [
        (Instruction.FAST_SYNC_READ, words(146, 1) + b"\x01"),
        (Instruction.FAST_BULK_READ, b"\x01\x92\x00\x01\x00"),
    ],
)
def test_a_fast_read_is_answered_as_for_all_servos(servo, code, parameters):
    (status,) = servo.broadcast(code, parameters)
    assert status == Packet2(BROADCAST, Instruction.STATUS, b"\x00\x01\x19")
    # The part of another servo would be missing.
    assert servo.broadcast(code, parameters + b"\x02\x92\x00\x01\x00") == []


@pytest.mark.parametrize(
    ("protocol", "code", "parameters", "name"),
    [
        (1, Instruction.SYNC_WRITE, b"\x20\2\2\0\1\1\7\0\3\0\3", "moving_speed"),
        (
            *(2, Instruction.SYNC_WRITE),
            *(words(112, 4) + b"\2\1\0\0\0\1\7\0\0\0", "profile_velocity"),
        ),
        (
            *(2, Instruction.BULK_WRITE),
            *(b"\2\x40\0\1\0\1\1\x70\0\4\0\7\0\0\0", "profile_velocity"),
        ),
    ],
)
def test_it_takes_its_part_of_a_group_write(servo, code, parameters, name):
    assert servo.broadcast(code, parameters) == []
    assert servo.read(name) == 7
    assert servo.read("torque_enable") == 0
    assert servo.writes == 1


@TWO
@pytest.mark.parametrize(("option", "left"), [(0xFF, (1, 1)), (1, (7, 1)), (2, (7, 3))])
def test_a_factory_reset_may_keep_id_and_baud_rate(servo, option, left):
    for name, value in (("operating_mode", 5), ("baud_rate", 3), ("id", 7)):
        servo.write(name, value)
    (status,) = servo.send(Instruction.FACTORY_RESET, [option], number=7)
    assert (status.id, servo.error(status)) == (7, 0)
    assert (servo.table["id"], servo.table["baud_rate"]) == left
    assert servo.table["operating_mode"] == 3


@TWO
def test_a_broadcast_resets_no_ids(servo):
    servo.write("operating_mode", 5)
    assert servo.broadcast(Instruction.FACTORY_RESET, b"\xff") == []
    assert servo.read("operating_mode") == 5


@pytest.mark.parametrize(
    ("protocol", "code", "parameters", "error"),
    [
        (1, Instruction.FACTORY_RESET, b"", Error1.INSTRUCTION),
        (1, 0x77, b"", Error1.INSTRUCTION),
        (1, Instruction.READ, b"\x03", Error1.INSTRUCTION),
        (1, Instruction.WRITE, b"\x03", Error1.INSTRUCTION),
        (1, Instruction.READ, b"\x00\xff", Error1.RANGE),
        (1, Instruction.WRITE, b"\x24\x00\x00", Error1.RANGE),
        (1, Instruction.WRITE, b"\x1e\x00\x10", Error1.ANGLE_LIMIT),
        (2, 0x77, b"", Refusal.INSTRUCTION),
        (2, Instruction.READ, b"\x00\x00\x01", Refusal.INSTRUCTION),
        (2, Instruction.WRITE, b"\x41\x00", Refusal.INSTRUCTION),
        (2, Instruction.REBOOT, b"\x00", Refusal.INSTRUCTION),
        (2, Instruction.CLEAR, b"\x01", Refusal.INSTRUCTION),
        (2, Instruction.FACTORY_RESET, b"\x03", Refusal.RANGE),
        (2, Instruction.READ, b"\x00\x00\xff\xff", Refusal.ACCESS),
        (2, Instruction.WRITE, b"\x00\x00\x00\x00", Refusal.ACCESS),
        (2, Instruction.WRITE, b"\x74\x00\x00\x00", Refusal.LENGTH),
        (2, Instruction.WRITE, b"\x74\x00\x00\x10\x00\x00", Refusal.LIMIT),
        (2, Instruction.WRITE, b"\x40\x00\x02", Refusal.RANGE),
        (2, Instruction.SYNC_WRITE, b"\x40\x00\x00\x00\x01", Refusal.ACCESS),
        (2, Instruction.BULK_WRITE, b"\x01\x40\x00\x00\x00", Refusal.ACCESS),
    ],
)
@pytest.mark.parametrize("torque", [0, 1])
def test_an_invalid_instruction_is_answered_by_an_error(
    servo, code, parameters, error, torque
):
    servo.write("torque_enable", torque)  # which locks the EEPROM in Protocol 2.0
    (status,) = servo.send(code, parameters)
    assert (servo.error(status), servo.data(status)) == (error, b"")
    assert len(servo.warned) == 1


def test_a_wrong_checksum_is_answered_with_an_error(servo, led):
    (status,) = servo.send(Instruction.PING, intact=False)
    assert servo.error(status) == servo.wrong_checksum
    assert servo.send(Instruction.PING, number=9, intact=False) == []
    group = servo.table.packets.group_read([1], led, 1)
    assert servo.broadcast(group.code, group.parameters, intact=False) == []


@TWO
def test_status_packets_of_other_servos_are_ignored(servo):
    assert servo.send(Instruction.STATUS, b"\x00") == []
    assert servo.warned == []


# Abuse.


def random_packet(rng, servo):
    """Return a packet that often means something."""
    code = rng.choice([*Instruction, rng.randrange(256)])
    number = rng.choice([1, 1, 1, BROADCAST, rng.randrange(253)])
    register = rng.choice(servo.table.registers)
    address = rng.choice([register.address, rng.randrange(700)])
    size = rng.choice([register.size, rng.randrange(40)])
    low, high = register.limits or (0, 1)
    value = rng.choice([low, high, rng.randint(low, high)])
    place, data = servo.words(address), servo.number(value, register.size)
    block = servo.words(address, size)
    parameters = rng.choice(
        [
            place + data,
            place + rng.randbytes(size),
            block,
            block + b"\x01" + data,
            b"\x01" + block + data,
            rng.randbytes(size),
            b"\x01\x44\x58\x4c\x22",  # of clear
            b"",
        ]
    )
    return servo.table.packets(number, code, parameters)


def check(servo):
    """Check that registers and command are valid."""
    table, command = servo.table, servo.command()
    # The servo itself sets these beyond what masters may write.
    free = "bus_watchdog", "goal_position"
    for register in table.registers:
        if register.limits and register.name not in free:
            register.check(table[register.name], "")
    if command is not None:
        assert math.isnan(command.position) != math.isnan(command.torque)
        assert 0.0 <= command.limit <= 1.0


@pytest.mark.parametrize(
    ("protocol", "refusals"),
    [
        (1, {Refusal.FAILED, Refusal.RANGE, Refusal.LIMIT}),
        (2, {*Refusal} - {Refusal.CHECKSUM}),
    ],
)
def test_ten_thousand_random_packets_leave_a_valid_servo(servo, refusals):
    rng = random.Random(24)
    seen = set()
    for count in range(10_000):
        packet = random_packet(rng, servo)
        # To be found under ID 1 again.
        servo.table["id"], servo.table["status_return_level"] = 1, 2
        for reply in servo.send(packet.code, packet.parameters, packet.id):
            seen.add(reply.status.refusal)
        if count % 10 == 0:
            servo.move(rng.uniform(-9, 9), rng.uniform(-9, 9), rng.uniform(-1, 1))
        if count % 50 == 0:
            check(servo)
    assert seen == {None} | refusals
