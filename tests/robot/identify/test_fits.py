import dataclasses as dc
import math

import numpy as np
import pytest
from helpers import fix, read, update
from hypothesis import assume, given
from hypothesis import strategies as st

from drake_srg.gripper.tendon import (
    MotorTemperature,
    MotorTemperatureConfig,
    TendonDriveConfig,
)
from drake_srg.robot.identify import fits
from drake_srg.robot.identify.fits import (
    AIR,
    HEAT_PARAMETERS,
    NEVER,
    PRESS_PARAMETERS,
    Motor,
    calibrated_zero,
    polls,
    predict_seconds,
    predict_stops,
)
from drake_srg.robot.identify.log import RISE, LogRow, vendor_log
from drake_srg.robot.identify.report import drive_values, overlay, report, spread
from drake_srg.scenario import SCENARIOS, load_scenario

MOTOR = Motor(stall_current=2.88, dead_band=0.12, most=0.965)
VALUES = {p.name: p.prior for p in PRESS_PARAMETERS} | {"position_gain": 8.0}
TORQUES = [LogRow("torque", float(p), seconds=0.256) for p in range(20, 80, 10)]


def test_current_starts_at_the_dead_band_and_ends_at_the_stall_current():
    current = MOTOR.current(np.array([0.0, 0.12, -0.12, 1.0, -1.0]))
    assert current == pytest.approx([0.0, 0.0, 0.0, 2.88, -2.88])


def test_more_torque_closes_further():
    stops = predict_stops(TORQUES, 2810.0, MOTOR, VALUES)
    assert np.all(np.diff(stops) <= 0.0)
    assert stops[0] > stops[-1] + 5.0


def test_friction_keeps_what_the_approach_has_wound_up():
    weak = [LogRow("position", 40.0, seconds=1.15)]
    stops = [
        predict_stops(weak, 2810.0, MOTOR, VALUES | {"gear_load": share})[0]
        for share in (0.01, 0.7)
    ]
    assert stops[1] < stops[0]


def test_a_stop_counts_from_the_calibrated_zero():
    low, high = (predict_stops(TORQUES, z, MOTOR, VALUES) for z in (2000.0, 2810.0))
    assert high - low == pytest.approx(810.0)
    assert calibrated_zero(vendor_log()) == 2811.0


@pytest.mark.parametrize(
    ("test", "seconds", "expected"),
    [
        ("position", 1.15, 1),
        ("position", 1.22, 2),
        ("torque", 0.128, 1),
        ("torque", 0.192, 2),
        ("torque", 0.256, 3),
        ("torque", math.nan, 1),
    ],
)
def test_the_test_tells_how_often_it_waited(test, seconds, expected):
    assert polls(LogRow(test, 20.0, seconds=seconds)) == expected


ROWS = vendor_log()
SPECIMENS = {
    "gripper_bench": "srg_specimen",
    "kitchen_tendon": "kitchen_tendon_specimen",
}


@pytest.fixture(scope="module")
def found():
    return fits.identify(ROWS)


def test_it_explains_the_vendors_log(found):
    current = [e for e in found.errors if e.quantity == "current"]
    assert all(abs(e.fitted - e.measured) <= e.allowed for e in current)
    assert spread(found, "stop")[0] < 6.0
    assert spread(found, "heating")[0] < 10.0


def test_it_predicts_the_rows_that_it_did_not_see(found):
    assert spread(found, "current")[1] < 10.0
    assert spread(found, "stop")[1] < 9.0


def test_the_specimen_saturates_below_the_data_sheet(found):
    assert found.motor.stall_current == pytest.approx(2.9, abs=0.1)
    assert found.motor.most == pytest.approx(987 / 1023)


def test_it_says_what_is_tied_and_what_it_cannot_tell(found):
    text = "\n".join(report(found))
    assert "stiffness, slack" in text
    assert "mostly assumed" in text
    assert "forces: no row measures one" in text


@pytest.mark.parametrize("base", SPECIMENS)
def test_the_specimens_are_what_the_vendors_log_gives(found, base):
    scenario = load_scenario(SPECIMENS[base], seed=0)
    motor = scenario.gripper.wire_motor
    values = dc.asdict(motor.drive) | dc.asdict(motor.drive.friction)
    for name, value in drive_values(found).items():
        assert values[name] == pytest.approx(value, rel=0.02), name
    text = (SCENARIOS / f"{SPECIMENS[base]}.yaml").read_text(encoding="utf-8")
    written = overlay(found, base, "an EZGripper measured by its vendor")
    assert [x.split(":")[0] for x in written.splitlines()[1:]] == [
        x.split(":")[0] for x in text.splitlines()[1:]
    ]


def test_a_made_gripper_is_recovered(monkeypatch):
    monkeypatch.setattr(fits, "STARTS", fits.STARTS[13:14])
    truth = {
        "stiffness": 60.0,
        "slack": 45.0,
        "gear": 0.015,
        "gear_load": 0.45,
        "stiction": 1.25,
        "torque_rise": 0.08,
        "inertia": 0.012,
        "position_gain": 8.0,
    }
    motor = Motor(stall_current=3.5, dead_band=0.08, most=0.965)
    pressing = [row for row in ROWS if row.test != "heating"]
    rng = np.random.default_rng(3)
    stops = predict_stops(pressing, 2811.0, motor, truth) + rng.normal(0, 1, 21)
    load = np.array([row.load for row in pressing]) / 1023
    current = 1e3 * motor.current(load) * rng.normal(1.0, 0.02, 21)
    made = [
        dc.replace(row, stop_counts=float(stop), current_ma=float(c))
        for row, stop, c in zip(pressing, stops, current, strict=True)
    ]
    # The zero is the median of the stops, also of made ones.
    fitted = fits._fit([*made, *ROWS[-5:]])[2]
    truth |= {"stall_current": 3.5, "dead_band": 0.08}
    # Where stops count from shifts the slack.
    for e in (*fitted["motor"].estimates, *fitted["press"].estimates):
        name = e.parameter.name
        if name != "slack":
            assert 0.8 * e.low <= truth[name] <= 1.2 * e.high, name


HEATED = Motor(stall_current=3.0, dead_band=0.1, most=1.0)
HEAT = {p.name: p.prior for p in HEAT_PARAMETERS}


def seconds(current_ma, start=AIR, before=math.nan, motor=HEATED):
    row = LogRow(
        *("heating", 30.0),
        current_ma=current_ma,
        temperature_c=start,
        before_ma=before,
    )
    return predict_seconds([row], motor, HEAT)[0]


def test_much_current_warms_the_heat_capacity_alone():
    # 12 V and 3 A at stall, all of it heat, and 1.2 W of electronics.
    power = 12.0 * 3.0 + 1.2
    assert seconds(3000.0, before=3000.0) == pytest.approx(
        5.0 * 113.0 / power, rel=0.02
    )


def test_the_heat_of_the_current_before_is_on_its_way():
    same, rested, hot = (seconds(1000.0, before=b) for b in (1000.0, math.nan, 2000.0))
    assert hot < same < rested < same + HEAT["winding_time"]


@given(st.floats(300.0, 2000.0), st.floats(0.0, 2000.0), st.floats(25.0, 40.0))
def test_the_times_are_those_of_the_simulated_motor(current, before, start):
    """The system in Drake and the fit have the same heat."""
    config = MotorTemperatureConfig(
        stall_current=HEATED.stall_current,
        period=0.25,  # it integrates exactly
        **{name: HEAT[name] for name in HEAT},
    )
    drive = TendonDriveConfig(dead_band=HEATED.dead_band)
    system = MotorTemperature(drive, config)
    expected = seconds(current, start, before)
    assume(expected < 1000.0)
    context = system.CreateDefaultContext()
    pwm = drive.pwm_of(current / 1e3 / HEATED.stall_current / drive.full_scale)
    assume(pwm < 1.0)
    fix(system, context, pwm=pwm, motor_state=[0.0, 0.0])
    context.SetDiscreteState(0, [start])
    context.SetDiscreteState(1, [system.heat(before / 1e3 / HEATED.stall_current)])
    for _ in range(round(expected / config.period)):
        update(system, context)
    (reached,) = read(system, context, "motor_temperature")
    assert reached - start == pytest.approx(RISE, abs=0.1)


@given(st.floats(50.0, 3000.0), st.floats(0.0, 60.0))
def test_it_takes_longer_with_less_current_and_from_warmer(current, start):
    assert seconds(0.9 * current, start) >= seconds(current, start)
    assert seconds(current, start + 1.0) >= seconds(current, start)


def test_it_never_warms_beyond_where_the_air_takes_all_heat():
    assert seconds(100.0, start=60.0) == NEVER
