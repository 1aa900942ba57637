"""Several servos on one line, as their masters see them."""

import contextlib
import dataclasses as dc
import math

import dynamixel_sdk
import numpy as np
import pytest

from drake_srg.robot.serve.commands import CommandInbox, Warnings
from drake_srg.robot.serve.dynamixel.bridge import (
    Arm,
    EmulatedBus,
    ServoBridge,
    ServoGripper,
    WiredGripper,
    station_mechanisms,
)
from drake_srg.robot.serve.dynamixel.mx64 import Mx64, Mx64P2
from drake_srg.robot.serve.dynamixel.protocol import (
    BROADCAST,
    Instruction,
    PacketReader,
)
from drake_srg.robot.serve.dynamixel.servo import MotorCommand
from drake_srg.scenario import load_scenario
from robot.serve.dynamixel.fake_station import CLOSED, COUNT, FakeStation, client_of
from robot.serve.dynamixel.servo_client import ServoClient
from robot.serve.dynamixel.simulated_gripper import SimulatedGripper

FIVE_AXES = load_scenario("assistive_arm")
TRAVEL = 0.69


def position(angle, limit=1.0):
    return MotorCommand(angle, np.nan, limit)


def torque(value, limit=1.0):
    return MotorCommand(np.nan, value, limit)


@pytest.fixture
def arm():
    return Arm(np.array([-1.0, -2.0]), np.array([1.0, 2.0]), np.array([2.0, 4.0]))


def test_the_five_axis_arm_has_a_servo_per_joint_and_one_for_the_gripper():
    arm, gripper = station_mechanisms(FIVE_AXES)
    assert (type(arm), len(arm.motors)) == (Arm, 5)
    assert (type(gripper), len(gripper.motors)) == (ServoGripper, 1)


def test_only_an_arm_of_servos_has_its_joints_on_the_bus():
    (wires,) = station_mechanisms(load_scenario("kitchen_tendon"))
    assert isinstance(wires, WiredGripper)


@pytest.mark.parametrize("changes", [{"bus_servos": False}, {"limits": None}])
def test_a_station_without_servos_is_refused(changes):
    plain = dc.replace(FIVE_AXES, arm=dc.replace(FIVE_AXES.arm, **changes))
    with pytest.raises(ValueError, match=r"--servo: (needs .* an arm of serv|arm.lim)"):
        station_mechanisms(plain)


def test_joints_turn_against_the_clock(arm):
    values = {
        "arm.state_measured": np.array([0.1, 0.2, 0.3, 0.4]),
        "arm.torque_measured": np.array([1.0, -8.0]),
    }
    first, second = arm.sense(values)
    assert first == (-0.1, -0.3, -0.5, 25.0)
    assert second == (-0.2, -0.4, 1.0, 25.0)  # no more than full PWM
    (angle,) = arm.command([position(-0.1), None]).values()
    np.testing.assert_equal(angle, [0.1, np.nan])


@pytest.mark.parametrize("silent", [None, torque(0.0)])
def test_a_joint_without_a_position_stays(arm, silent):
    (angle,) = arm.command([silent, position(9.0)]).values()
    np.testing.assert_equal(angle, [np.nan, -2.0])  # the other ends at its limit


def test_a_gripper_s_servo_commands_closure():
    gripper = ServoGripper(TRAVEL, joints=2)
    values = {
        "gripper.state_measured": np.array([0.3, 0.2, 0.01, 0.02]),
        "gripper.pwm": np.array([0.4, 0.1]),
    }
    assert gripper.sense(values) == [(-0.3, -0.01, -0.4, 25.0)]
    half = gripper.command([position(-TRAVEL / 2, 0.5)])
    assert half["gripper.closure_commanded"] == [0.5]
    assert half["gripper.force_limit"] == [0.5]
    assert np.isnan(half["gripper.joint_position_commanded"]).all()
    assert gripper.command([position(1.0)])["gripper.closure_commanded"] == [0.0]


def test_a_gripper_without_torque_is_free():
    free = ServoGripper(TRAVEL, joints=2).command([torque(0.0)])
    assert free["gripper.force_limit"] == [0.0]
    assert "gripper.closure_commanded" not in free


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


# SAKE's driver.


@pytest.mark.slow
def test_sake_s_driver_calibrates_moves_and_holds(station):
    client = client_of(station)
    client.calibrate()
    assert client.zero == 3298 - round(CLOSED / COUNT)
    assert client.get_position() == 0
    client.goto_position(60, 100)
    assert client.get_position() == 60
    assert station.angle == pytest.approx(CLOSED - 1500 * COUNT, abs=COUNT)
    station.sleep(0.1)
    assert station.commands["gripper.force_limit"] == pytest.approx([0.13])
    client.goto_position(0, 50)
    assert client.get_position() == 0
    station.sleep(0.1)
    # Held by a goal torque of 104 units of 4.5 mA. The stall current is 4.1 A, and full
    # PWM gives 800/1023 of the stall torque.
    assert np.isnan(station.commands["gripper.motor_position_commanded"][0])
    torque = station.commands["gripper.motor_torque_commanded"]
    assert torque == pytest.approx([104 * 4.5e-3 / 4.1 * 1023 / 800])
    assert station.commands["gripper.force_limit"] == pytest.approx([1.0])
    assert client.get_temperature() == 30
    client.release()
    assert station.warnings == []


@pytest.mark.slow
def test_sake_s_driver_recovers_from_an_overload(station):
    client = client_of(station)
    client.write(34, 800)
    client.write(30, 0)  # far beyond the closed fingers
    station.sleep(11.0)
    assert client.check_overload_and_recover() == (32, 0)
    assert client.check_overload_and_recover() == (0, 0)
    station.sleep(0.1)
    assert station.commands["gripper.motor_torque_commanded"] == [0.0]
    assert len(station.warnings) == 1


# Other sources of commands.


def grasp(percent=50):
    """Return another source's command: a closure, and no motor command."""
    ports = ("motor_position_commanded", "motor_torque_commanded", "force_limit")
    free = {f"gripper.{port}": np.array([np.nan]) for port in ports}
    return {"gripper.closure_commanded": np.array([percent / 100.0]), **free}


@pytest.fixture
def quiet():
    """A bridge whose motor stands still: (bridge, inbox, client)."""
    inbox = CommandInbox([], Warnings(print))
    with contextlib.closing(ServoBridge(inbox, "tcp:0")) as bridge:
        client = ServoClient(f"socket://{bridge.address}", lambda _: None)
        bridge.update(0.0, motor())
        inbox.take()
        yield bridge, inbox, client
        client.close()


def motor(angle=0.0):
    values = map(np.array, ([angle, 0.0], [0.0], [25.0]))
    return dict(zip(WiredGripper.ports, values, strict=True))


def test_a_repeated_write_wins_over_another_source(quiet):
    bridge, inbox, client = quiet
    client.write(30, 2500)
    first = inbox.take()
    inbox.put(grasp(), "/grasp")
    bridge.update(0.005, motor())
    inbox.take()
    client.write(30, 2500)
    np.testing.assert_equal(inbox.take(), first)
    assert np.isfinite(first["gripper.motor_position_commanded"]).all()


def test_another_source_interrupts_a_slow_motion(quiet):
    bridge, inbox, client = quiet
    client.write(32, 20)
    client.write(30, 1000)
    inbox.put(grasp(), "/grasp")
    for k in range(100):
        bridge.update(0.005 * k, motor())
    client.write(34, 104)  # a register that moves nothing
    np.testing.assert_equal(inbox.take(), grasp())


def test_write_packets_are_counted_once_good_or_bad(quiet):
    bridge, inbox, client = quiet
    before = inbox.received
    client.write(32, 2)
    client.write(30, 1000)
    client.read(36, 2)
    for k in range(100):
        bridge.update(0.005 * k, motor())
    client.send(3, 0, 1)  # read only
    assert inbox.received == before + 3


# An independent driver.


@pytest.fixture
def master(monkeypatch):
    """dynamixel-sdk at the servo's pseudo terminal: (handler, port, station)."""
    # Its default timeout of 34 ms is too short on a busy machine.
    monkeypatch.setattr(dynamixel_sdk.port_handler, "LATENCY_TIMER", 250)
    with FakeStation("pty") as station:
        port = dynamixel_sdk.PortHandler(station.bridge.address)
        assert port.openPort()
        assert port.setBaudRate(57600)
        yield dynamixel_sdk.PacketHandler(1.0), port, station
        port.closePort()


def test_dynamixel_sdk_pings_reads_and_writes(master):
    handler, port, station = master
    assert handler.ping(port, 1) == (310, dynamixel_sdk.COMM_SUCCESS, 0)
    goal = 3298 - 1000
    assert handler.write2ByteTxRx(port, 1, 30, goal) == (0, 0)
    station.sleep(3.0)
    position, *outcome = handler.read2ByteTxRx(port, 1, 36)
    assert outcome == [dynamixel_sdk.COMM_SUCCESS, 0]
    assert abs(position - goal) <= 1
    assert station.angle == pytest.approx(1000 * COUNT, abs=COUNT)


def test_dynamixel_sdk_writes_and_reads_in_groups(master):
    handler, port, _ = master
    write = dynamixel_sdk.GroupSyncWrite(port, handler, 30, 4)
    write.addParam(1, [0x00, 0x08, 0x64, 0x00])
    write.addParam(2, [0x00, 0x00, 0x00, 0x00])
    assert write.txPacket() == dynamixel_sdk.COMM_SUCCESS
    # Its GroupBulkRead calls this with one argument too many (version 4.1.0).
    assert handler.bulkReadTx(port, [4, 1, 30], 3) == dynamixel_sdk.COMM_SUCCESS
    expected = [0x00, 0x08, 0x64, 0x00], dynamixel_sdk.COMM_SUCCESS, 0
    assert handler.readRx(port, 1, 4) == expected


@pytest.mark.slow
def test_dynamixel_sdk_receives_errors(master):
    handler, port, _ = master
    assert handler.write2ByteTxRx(port, 1, 34, 2000)[1] == 8
    assert handler.factoryReset(port, 1)[1] == 64
    assert handler.ping(port, 2)[1] == dynamixel_sdk.COMM_RX_TIMEOUT


# The simulated gripper.


@pytest.mark.slow
def test_sake_s_driver_moves_the_simulated_gripper():
    with SimulatedGripper("tcp:0") as gripper:
        client = ServoClient(
            f"socket://{gripper.bridge.address}", gripper.sleep, lambda: gripper.time
        )
        client.calibrate()
        closed = gripper.q
        # In the vendor's geometry the pads meet at 100.7 degrees.
        assert closed[:2] == pytest.approx(np.deg2rad([100.7] * 2), abs=0.05)

        client.goto_position(100, 100)
        assert client.get_position() == pytest.approx(100, abs=1)
        gripper.sleep(2.0)  # the springs open the fingers slower than the motor turns
        assert gripper.q == pytest.approx([0.0] * 4, abs=0.02)

        client.goto_position(0, 50)
        assert client.get_position() <= 1
        assert gripper.q[:2] == pytest.approx(closed[:2], abs=0.05)
        gripper.sleep(1.0)
        # 104 units of 4.5 mA, of 4.1 A at stall; 800/1023 of the stall torque pull each
        # wire with 308 N.
        held = 308.0 * 104 * 4.5e-3 / 4.1 * 1023 / 800
        assert gripper.force == pytest.approx([held, held], rel=0.05)

        client.goto_position(50, 50)
        assert client.get_position() == pytest.approx(50, abs=1)
        assert 25 <= client.get_temperature() < 30
        assert client.check_overload_and_recover() == (0, 0)
    assert gripper.told == []
