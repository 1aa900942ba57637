"""The test of a gripper by its servo's registers."""

import contextlib
import socket

import pytest

from drake_srg.robot.drive.dynamixel.bus import Reply, ServoBus, open_line
from drake_srg.robot.identify.log import log_text, parse_log
from drake_srg.robot.identify.press_test import (
    Plan,
    RecordingError,
    WatchedServo,
    record,
)
from drake_srg.robot.serve.dynamixel.registers import (
    CLOCKWISE,
    FULL_TORQUE,
    ControlTable1,
)
from robot.serve.dynamixel.simulated_gripper import SimulatedGripper

MEET, STRETCH = 2810, 60.0  # counts; by the full torque
SHORT = Plan(position=(20, 40, 60, 80), torque=(20, 30, 40, 50), heating=(40, 80))


class Gripper:
    """A bus with a servo whose spool goes to its goal at once, and its clock.

    Tips that press on each other yield with the torque, and warm the motor.

    Attributes:
        table: The registers.
        loads: Every load that the servo had, of 1023.
        fault: Fault that it reports.
    """

    def __init__(self):
        self.table, self.time, self.heat, self.fault = ControlTable1(), 0.0, 30.0, ""
        self.loads = []
        self.table["present_position"] = MEET + 300
        self.table["cw_angle_limit"] = 100
        self.pause(0.0)

    def servo(self, hottest=60.0):
        return WatchedServo(self, 1, hottest, lambda: self.time, self.pause)

    def pause(self, duration):
        table = self.table
        load = table["torque_limit"]
        if table["torque_control_mode"]:
            load = min(load, table["goal_torque"] - CLOCKWISE)
        end = MEET - STRETCH * load / FULL_TORQUE
        goal = -1e4 if table["torque_control_mode"] else table["goal_position"]
        load = load if table["torque_enable"] and goal < end else 0
        if table["torque_enable"]:
            table["present_position"] = round(max(goal, end))
        self.loads.append(load)
        self.time += duration
        self.heat += 1.0 * (load / FULL_TORQUE) ** 2 * duration
        table["present_temperature"] = int(self.heat)
        table["present_load"] = CLOCKWISE + load
        table["current"] = 2048 - round(3.0 * load / FULL_TORQUE / 4.5e-3)

    def read_all(self, numbers, name):
        return {1: Reply({name: self.table[name]}, self.fault)}

    def write(self, number, name, value):
        register = self.table.register(name)
        self.table.write(register.address, register.encode(value))
        if name in ("goal_torque", "goal_position"):
            self.table["torque_enable"] = 1


def released(gripper):
    table = gripper.table
    return (table["torque_enable"], table["cw_angle_limit"]) == (0, 100)


def test_it_measures_every_set_point_of_its_plan():
    gripper = Gripper()
    rows = list(record(gripper.servo(), SHORT))
    assert len(parse_log(log_text(rows), "log")) == len(rows) == 10
    for row in rows:
        load = int(row.setpoint_pct / 100 * FULL_TORQUE)
        assert row.load == load
        assert row.current_ma == pytest.approx(3000 * load / FULL_TORQUE, abs=4.5)
        if row.test != "heating":
            assert row.stop_counts == round(MEET - STRETCH * load / FULL_TORQUE)
    # Rows of position also count the wait of 1 s.
    seconds = [row.seconds for row in rows]
    assert seconds[:4] == pytest.approx([1.16] * 4, abs=0.02)
    assert seconds[4:8] == pytest.approx([0.13] * 4, abs=0.02)
    assert seconds[8:] == pytest.approx([5 / 0.4**2, 5 / 0.8**2], rel=0.25)
    assert released(gripper)


def test_a_hot_servo_is_released():
    gripper = Gripper()
    test = record(gripper.servo(hottest=32.0), SHORT)
    with pytest.raises(RecordingError, match=r"^servo 1: is at 33 degC \(allowed: 32"):
        list(test)
    assert released(gripper)


def test_a_hot_servo_is_released_while_it_heats():
    gripper = Gripper()
    gripper.heat = 55.0  # the calibration leaves it below 60 degC
    plan = Plan(position=(), torque=(), heating=(60,))
    with pytest.raises(RecordingError, match=r"^servo 1: is at 61 degC \(allowed: 60"):
        list(record(gripper.servo(), plan))
    assert gripper.heat < 61.5
    assert released(gripper)


@pytest.mark.parametrize("duration", [0.05, 0.25, 1.0])
def test_every_wait_looks_at_the_temperature_and_lasts_no_longer(duration):
    gripper = Gripper()
    servo = gripper.servo()
    begun = gripper.time
    servo.sleep(duration)
    assert gripper.time - begun == pytest.approx(duration)
    gripper.heat = 61.0
    gripper.pause(0.0)
    with pytest.raises(RecordingError, match=r"is at 61 degC"):
        servo.sleep(duration)


def test_a_servo_that_stays_cool_is_released():
    gripper = Gripper()
    plan = Plan(position=(), torque=(), heating=(10,), patience=20.0)
    with pytest.raises(RecordingError, match=r"^heating 10 %: from 3\d degC to 3\d"):
        list(record(gripper.servo(), plan))
    assert released(gripper)


def test_a_test_that_is_left_releases_the_servo():
    gripper = Gripper()
    with contextlib.closing(record(gripper.servo(), SHORT)) as rows:
        assert next(rows).test == "position"
        assert not released(gripper)
    assert released(gripper)


def test_a_fault_is_told():
    gripper = Gripper()
    rows = record(gripper.servo(), SHORT)
    next(rows)
    gripper.fault = "overheating"
    with pytest.raises(RecordingError, match=r"^servo 1: overheating"):
        list(rows)


@pytest.mark.slow
def test_it_tests_the_simulated_gripper():
    with contextlib.closing(socket.socket()) as free:
        free.bind(("127.0.0.1", 0))
        where = f"tcp:127.0.0.1:{free.getsockname()[1]}"
    with SimulatedGripper(where) as gripper:
        bus = ServoBus(open_line(where, 57600), timeout=5.0)
        servo = WatchedServo(
            bus, 1, 60.0, clock=lambda: gripper.time, pause=gripper.sleep
        )
        # Its drive gives 40 % at most.
        plan = Plan(position=(15, 30), torque=(30,), heating=())
        rows = list(record(servo, plan))
        bus.close()
    assert gripper.told == []
    soft, hard = (row.current_ma for row in rows[:2])
    assert 1.6 < hard / soft < 2.4
    assert rows[1].stop_counts < rows[0].stop_counts  # the wires stretch
    # The goal torque is a current: 1023 units of 4.5 mA.
    assert rows[2].current_ma == pytest.approx(1381.0, rel=0.03)
