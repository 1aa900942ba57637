"""The packets of an MX-64 with Protocol 2.0."""

import math
import random

import pytest

from drake_srg.robot.serve.dynamixel.protocol import (
    BROADCAST,
    Error2,
    Instruction,
    Packet2,
    PacketReader,
)
from drake_srg.robot.serve.dynamixel.registers import ControlTable2
from robot.serve.dynamixel.servo_with_master import ServoWithMaster2

LED, TEMPERATURE = 65, 146
PONG = Packet2(1, Instruction.STATUS, b"\x00\x37\x01\x2d")


@pytest.fixture
def servo():
    return ServoWithMaster2()


def words(*numbers):
    return b"".join(number.to_bytes(2, "little") for number in numbers)


def test_a_ping_tells_model_and_firmware(servo):
    assert servo.send(Instruction.PING) == [PONG]
    assert servo.broadcast(Instruction.PING) == [PONG]
    assert servo.send(Instruction.PING, number=2) == []


def test_it_obeys_broadcasts_without_a_reply(servo):
    assert servo.broadcast(Instruction.WRITE, words(LED) + b"\x01") == []
    assert servo.read("led") == 1
    assert servo.broadcast(Instruction.READ, words(LED, 1)) == []


@pytest.mark.parametrize(("level", "replies"), [(0, 0), (1, 2), (2, 3)])
def test_the_status_return_level_selects_replies(servo, level, replies):
    servo.write("status_return_level", level)
    assert len(servo.send(Instruction.PING)) == 1
    sent = servo.send(Instruction.READ, words(LED, 1))
    sent += servo.broadcast(Instruction.SYNC_READ, words(LED, 1) + b"\x01")
    assert len(sent + servo.send(Instruction.WRITE, words(LED) + b"\x01")) == replies


def test_a_registered_write_waits_for_the_action(servo):
    servo.write("led", 1, code=Instruction.REG_WRITE)
    assert (servo.read("led"), servo.read("registered")) == (0, 1)
    assert servo.broadcast(Instruction.ACTION) == []
    assert (servo.read("led"), servo.read("registered")) == (1, 0)
    (status,) = servo.send(Instruction.ACTION)
    assert servo.error(status) == Error2.INSTRUCTION


@pytest.mark.parametrize(
    ("code", "parameters"),
    [
        (Instruction.SYNC_READ, words(TEMPERATURE, 1) + b"\x02\x01"),
        (Instruction.BULK_READ, b"\x02\x00\x00\x02\x00\x01\x92\x00\x01\x00"),
    ],
)
def test_it_answers_its_part_of_a_group_read(servo, code, parameters):
    status = Packet2(1, Instruction.STATUS, b"\x00\x19")
    assert servo.broadcast(code, parameters) == [status]
    servo.write("id", 3)
    assert servo.broadcast(code, parameters) == []


def test_a_group_read_beyond_the_table_is_an_error(servo):
    (status,) = servo.broadcast(Instruction.SYNC_READ, words(660, 4) + b"\x01")
    assert (servo.error(status), servo.data(status)) == (Error2.ACCESS, b"")


@pytest.mark.parametrize(
    ("code", "parameters"),
    [
        (Instruction.FAST_SYNC_READ, words(TEMPERATURE, 1) + b"\x01"),
        (Instruction.FAST_BULK_READ, b"\x01\x92\x00\x01\x00"),
    ],
)
def test_a_fast_read_is_answered_as_for_all_servos(servo, code, parameters):
    (status,) = servo.broadcast(code, parameters)
    assert status == Packet2(BROADCAST, Instruction.STATUS, b"\x00\x01\x19")
    # The part of another servo would be missing.
    assert servo.broadcast(code, parameters + b"\x02\x92\x00\x01\x00") == []


@pytest.mark.parametrize(
    ("code", "parameters"),
    [
        (Instruction.SYNC_WRITE, words(112, 4) + b"\x02\1\0\0\0\x01\7\0\0\0"),
        (
            *(Instruction.BULK_WRITE,),
            *(b"\x02\x40\x00\x01\x00\x01\x01\x70\x00\x04\x00\7\0\0\0",),
        ),
    ],
)
def test_it_takes_its_part_of_a_group_write(servo, code, parameters):
    assert servo.broadcast(code, parameters) == []
    assert servo.read("profile_velocity") == 7
    assert servo.read("torque_enable") == 0
    assert servo.writes == 1


@pytest.mark.parametrize(("option", "left"), [(0xFF, (1, 1)), (1, (7, 1)), (2, (7, 3))])
def test_a_factory_reset_may_keep_id_and_baud_rate(servo, option, left):
    for name, value in (("operating_mode", 5), ("baud_rate", 3), ("id", 7)):
        servo.write(name, value)
    (status,) = servo.send(Instruction.FACTORY_RESET, [option], number=7)
    assert (status.id, servo.error(status)) == (7, 0)
    assert (servo.table["id"], servo.table["baud_rate"]) == left
    assert servo.table["operating_mode"] == 3


def test_a_broadcast_resets_no_ids(servo):
    servo.write("operating_mode", 5)
    assert servo.broadcast(Instruction.FACTORY_RESET, b"\xff") == []
    assert servo.read("operating_mode") == 5


@pytest.mark.parametrize(
    ("code", "parameters", "error"),
    [
        (0x77, b"", Error2.INSTRUCTION),
        (Instruction.READ, b"\x00\x00\x01", Error2.INSTRUCTION),
        (Instruction.WRITE, b"\x41\x00", Error2.INSTRUCTION),
        (Instruction.REBOOT, b"\x00", Error2.INSTRUCTION),
        (Instruction.CLEAR, b"\x01", Error2.INSTRUCTION),
        (Instruction.FACTORY_RESET, b"\x03", Error2.DATA_RANGE),
        (Instruction.READ, b"\x00\x00\xff\xff", Error2.ACCESS),
        (Instruction.WRITE, b"\x00\x00\x00\x00", Error2.ACCESS),
        (Instruction.WRITE, b"\x74\x00\x00\x00", Error2.DATA_LENGTH),
        (Instruction.WRITE, b"\x74\x00\x00\x10\x00\x00", Error2.DATA_LIMIT),
        (Instruction.WRITE, b"\x40\x00\x02", Error2.DATA_RANGE),
        (Instruction.SYNC_WRITE, b"\x40\x00\x00\x00\x01", Error2.ACCESS),
        (Instruction.BULK_WRITE, b"\x01\x40\x00\x00\x00", Error2.ACCESS),
    ],
)
@pytest.mark.parametrize("torque", [0, 1])
def test_an_invalid_instruction_is_answered_by_an_error(
    servo, code, parameters, error, torque
):
    servo.write("torque_enable", torque)  # which locks the EEPROM
    (status,) = servo.send(code, parameters)
    assert (servo.error(status), servo.data(status)) == (error, b"")
    assert len(servo.warned) == 1


def test_a_wrong_crc_is_answered_with_an_error(servo):
    (status,) = servo.send(Instruction.PING, intact=False)
    assert servo.error(status) == Error2.CRC
    assert servo.send(Instruction.PING, number=9, intact=False) == []
    parameters = words(LED, 1) + b"\x01"
    code = Instruction.SYNC_READ
    assert servo.send(code, parameters, BROADCAST, intact=False) == []


def test_status_packets_of_other_servos_are_ignored(servo):
    assert servo.send(Instruction.STATUS, b"\x00") == []
    assert servo.warned == []


# Abuse.


def random_packet(rng):
    """Return a packet that often means something."""
    code = rng.choice([*Instruction, rng.randrange(256)])
    number = rng.choice([1, 1, 1, BROADCAST, rng.randrange(253)])
    register = rng.choice(ControlTable2.registers)
    address = rng.choice([register.address, rng.randrange(700)])
    size = rng.choice([register.size, rng.randrange(40)])
    low, high = register.limits or (0, 1)
    value = rng.choice([low, high, rng.randint(low, high)])
    data = (value & (1 << 8 * register.size) - 1).to_bytes(register.size, "little")
    parameters = rng.choice(
        [
            words(address) + data,
            words(address) + rng.randbytes(size),
            words(address, size),
            words(address, size) + bytes([1]) + data,
            bytes([1]) + words(address, size) + data,
            rng.randbytes(size),
            b"\x01\x44\x58\x4c\x22",  # of clear
            b"",
        ]
    )
    return Packet2(number, code, parameters)


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


def test_ten_thousand_random_packets_leave_a_valid_servo(servo):
    rng = random.Random(24)
    codes = set()
    for count in range(10_000):
        packet = random_packet(rng)
        # To be found under ID 1 again.
        servo.table["id"], servo.table["status_return_level"] = 1, 2
        for status in servo.send(packet.code, packet.parameters, packet.id):
            assert status.intact and status.code == Instruction.STATUS
            codes.add(status.parameters[0] & 0x7F)
        if count % 10 == 0:
            servo.move(rng.uniform(-9, 9), rng.uniform(-9, 9), rng.uniform(-1, 1))
        if count % 50 == 0:
            check(servo)
    assert codes == {0, *Error2} - {Error2.CRC}


def test_damaged_streams_neither_stop_nor_confuse_it(servo):
    rng = random.Random(25)
    reader, time = PacketReader(Packet2), 0.0
    for _ in range(3000):
        wire = bytearray(random_packet(rng).encode())
        at = rng.randrange(len(wire))
        match rng.randrange(5):
            case 0:
                del wire[at:]  # truncated
            case 1:
                wire[-2] ^= 1 << rng.randrange(8)  # wrong CRC
            case 2:
                wire[5:7] = rng.randbytes(2)  # a lie about the length
            case 3:
                wire[at:at] = rng.randbytes(rng.randrange(20))
            case 4:
                wire = bytearray(rng.randbytes(at))
        time += rng.choice([0.0, 0.01, 0.2])
        for packet in reader.feed(bytes(wire), time):
            servo.answer(packet)
        assert reader.pending < 1024
    check(servo)
    servo.table["id"] = 1
    ping = Packet2(1, Instruction.PING)
    assert list(reader.feed(ping.encode(), time + 1.0)) == [ping]
