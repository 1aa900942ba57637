from types import SimpleNamespace

import pytest

from drake_srg.experiments.vendor_test import VendorTest, press_bench, warm
from drake_srg.robot.identify.fits import Motor, predict_seconds
from drake_srg.robot.identify.log import LogRow
from drake_srg.scenario import load_scenario


class FakeStand:
    """Registers of a spool that closes by 100 counts per 50 ms, down to 2800."""

    def __init__(self):
        self.position, self.written = 3000, []
        self.rig = SimpleNamespace(time=0.0)

    def sleep(self, duration):
        self.rig.time += duration
        if duration == 0.05:
            self.position = max(self.position - 100, 2800)

    def write(self, name, value):
        self.written.append((name, value))
        self.sleep(0.016)

    def read(self, name):
        self.sleep(0.016)
        return self.position

    def read_current(self):
        return 1.5

    def read_load(self):
        return 600


def test_a_press_is_read_when_the_spool_has_stopped():
    stand = FakeStand()
    test = VendorTest(stand)
    shown = test.press(LogRow("position", 50.0, seconds=1.22))
    assert shown.stop_counts == 2800
    assert shown.current_ma == pytest.approx(1500.0)
    assert shown.load == 600
    assert shown.seconds > 1.0
    assert ("torque_limit", 511) in stand.written
    assert ("goal_position", test.zero - 250) in stand.written


def test_torque_control_gets_the_goal_torque_that_closes():
    stand = FakeStand()
    shown = VendorTest(stand).press(LogRow("torque", 20.0))
    assert ("goal_torque", 1024 + 204) in stand.written
    assert shown.seconds < 0.5


def test_the_bench_has_the_servos_own_gain():
    bench = press_bench("gripper_bench", 0.965, 4.0)
    # 4 of 1023 per count, 652 counts per rad.
    assert bench.gripper.servo.kp[0] * 0.965 == pytest.approx(2.549, abs=1e-3)
    assert bench.gripper.servo.kff1 == [0.0]


def test_the_motor_warms_as_the_identification_says():
    motor = load_scenario("srg_specimen").gripper.wire_motor
    row = LogRow("heating", 45.0, current_ma=1693.0, temperature_c=43.0)
    heat = motor.temperature
    same = Motor(heat.stall_current, motor.drive.dead_band, 1.0)
    values = {
        "heat_capacity": heat.heat_capacity,
        "thermal_resistance": heat.thermal_resistance,
        "idle_power": heat.idle_power,
    }
    expected = predict_seconds([row], same, values)[0]
    assert warm(motor, row) == pytest.approx(expected, abs=0.2)
