"""Several servos on one line, as their masters see them."""

import math

import numpy as np
import pytest

from drake_srg.bridges.commands import CommandInbox, Warnings
from drake_srg.bridges.dynamixel.emulated_bus import EmulatedBus
from drake_srg.bridges.dynamixel.mechanisms import Arm, ServoGripper
from drake_srg.bridges.dynamixel.mx64 import Mx64
from drake_srg.bridges.dynamixel.mx64_2 import Mx64P2
from drake_srg.bridges.dynamixel.protocol import BROADCAST, Instruction, PacketReader

POSITION = "arm.position_desired"
GOAL, PRESENT, TORQUE = 30, 36, 24  # addresses in Protocol 1.0


class Line:
    """A master at a bus of two joints and a gripper."""

    def __init__(self, kind):
        self.warned = []
        self.inbox = CommandInbox([], Warnings(self.warned.append))
        ends = np.array([2.0, 2.0])
        parts = [Arm(-ends, ends, ends), ServoGripper(0.69, 2)]
        self.bus = EmulatedBus(self.inbox, parts, kind, self.inbox.warnings.warn)
        self.time = 0.0
        self.move()

    def move(self, q=(0.1, -0.2)):
        self.time += 0.01
        self.bus.sense(
            self.time,
            {
                "arm.state_measured": np.array([*q, 0.0, 0.0]),
                "arm.torque_measured": np.zeros(2),
                "gripper.state_measured": np.zeros(4),
                "gripper.pwm": np.zeros(2),
            },
        )

    def send(self, number, code, parameters=b""):
        packet = self.bus.packets(number, code, bytes(parameters))
        (reply,) = self.bus.answer([packet])
        return list(PacketReader(self.bus.packets).feed(reply, 0.0))


@pytest.fixture
def line():
    return Line(Mx64)


def word(value):
    return value.to_bytes(2, "little", signed=value < 0)


def counts(q):
    return round(2048 + q * 4096 / math.tau)


@pytest.mark.parametrize("kind", [Mx64, Mx64P2])
def test_each_servo_has_its_id(kind):
    line = Line(kind)
    for number in (1, 2, 3):
        (reply,) = line.send(number, Instruction.PING)
        assert reply.id == number
    assert line.send(4, Instruction.PING) == []
    replies = line.send(BROADCAST, Instruction.PING)
    assert [reply.id for reply in replies] in ([], [1, 2, 3])


def test_a_bulk_read_is_answered_in_its_order(line):
    blocks = [2, 2, PRESENT, 1, 3, TORQUE, 2, 1, PRESENT]
    replies = line.send(BROADCAST, Instruction.BULK_READ, [0, *blocks])
    assert [(reply.id, reply.parameters) for reply in replies] == [
        (2, word(counts(-0.2))),
        (3, b"\0"),
        (1, word(counts(0.1))),
    ]


def test_a_sync_read_is_answered_in_its_order():
    line = Line(Mx64P2)
    replies = line.send(
        BROADCAST, Instruction.SYNC_READ, [*word(132), *word(4), 2, 9, 1]
    )
    angles = [int.from_bytes(r.parameters[1:], "little") for r in replies]
    assert [reply.id for reply in replies] == [2, 1]
    assert angles == [counts(-0.2), counts(0.1)]


def test_a_sync_write_commands_all_joints_at_once(line):
    data = [GOAL, 2, 1, *word(counts(0.5)), 2, *word(counts(-0.5))]
    assert line.send(BROADCAST, Instruction.SYNC_WRITE, data) == []
    taken = line.inbox.take()
    assert taken.keys() == {POSITION}
    assert taken[POSITION] == pytest.approx([0.5, -0.5], abs=math.tau / 4096)


def test_a_joint_that_nobody_commands_stays(line):
    line.send(2, Instruction.WRITE, [GOAL, *word(counts(1.0))])
    np.testing.assert_equal(np.isnan(line.inbox.take()[POSITION]), [True, False])


@pytest.mark.parametrize("kind", [Mx64, Mx64P2])
def test_a_servo_that_reboots_leaves_its_joint_where_it_is(kind):
    line = Line(kind)
    torque = 24 if kind is Mx64 else 64
    place = bytes([torque]) if kind is Mx64 else word(torque)
    for number in (1, 2):
        line.send(number, Instruction.WRITE, place + b"\1")
    line.inbox.take()
    line.bus.servos[1].reboot()
    line.move()
    np.testing.assert_equal(np.isnan(line.inbox.take()[POSITION]), [True, False])
    assert line.bus.servos[1].table["torque_enable"] == 0
    assert line.bus.servos[1].table["present_position"] == counts(0.1)
    assert line.bus.servos[1].table["id"] == 1


def test_another_source_commands_a_part_and_leaves_the_other(line):
    line.send(1, Instruction.WRITE, [GOAL, *word(counts(0.5))])
    line.send(3, Instruction.WRITE, [GOAL, *word(2300)])
    line.inbox.put({POSITION: np.zeros(2)}, "/kuka")
    line.inbox.take()
    line.move()
    line.send(1, Instruction.WRITE, [32, *word(100)])  # moves nothing
    assert line.inbox.take() == {}
    line.send(3, Instruction.WRITE, [GOAL, *word(2400)])
    assert "gripper.closure_commanded" in line.inbox.take()


def test_warnings_name_the_servo(line):
    line.send(2, Instruction.WRITE, [0, 1])
    (text,) = line.warned
    assert text.startswith("servo 2: refused a packet")
