import csv
import math

import numpy as np
import pytest
from helpers import fix, read, update
from hypothesis import assume, given
from hypothesis import strategies as st
from pydrake.autodiffutils import AutoDiffXd

from drake_srg.common.exceptions import ScenarioError
from drake_srg.gripper.tendon import (
    DriveFrictionConfig,
    MotorTemperature,
    MotorTemperatureConfig,
    TendonDrive,
    TendonDriveConfig,
    base_moment_arm,
    motor_load,
    reduce_magnitude,
    tip_moment_arm,
    transmitted_share,
    wire_slip,
    wire_travel,
)
from experiments import data

CONFIG = TendonDriveConfig()
PERIOD = 0.001
ANGLES = st.floats(0.0, 1.745)


def make(*, angle=0.0, speed=0.0, q=(0, 0, 0, 0), v=(0, 0, 0, 0), pwm=0.0):
    drive = TendonDrive(CONFIG, PERIOD)
    context = drive.CreateDefaultContext()
    context.SetDiscreteState([angle, speed])
    fix(drive, context, pwm=pwm, state_measured=[*q, *v])
    return drive, context


def run(drive, context, duration):
    for _ in range(round(duration / PERIOD)):
        update(drive, context)
    return read(drive, context, "motor_state")


def test_the_drive_has_the_figures_of_the_data_sheets():
    # 800 of 1023 of 6.0 N m on two wires at 7.6 mm.
    assert CONFIG.full_torque == pytest.approx(4.692, abs=1e-3)
    assert CONFIG.full_wire_force == pytest.approx(308.7, abs=0.1)
    assert CONFIG.force_limit_of(CONFIG.full_wire_force) == pytest.approx(1.0)
    assert CONFIG.force_limit_of(0.0) == 0.0


@pytest.mark.parametrize("force", [-1.0, 309.0, float("nan")])
def test_a_wire_force_beyond_the_servo_is_refused(force):
    with pytest.raises(ScenarioError, match=r"wire force .*: the servo gives 0 .. 309"):
        CONFIG.force_limit_of(force)


def test_without_load_the_motor_reaches_its_speed():
    # Wires that unwind are slack, so nothing loads the motor.
    drive, context = make(pwm=-0.5)
    speed = run(drive, context, 0.5)[1]
    assert speed == pytest.approx(-0.5 * 800 / 1023 * 6.6, rel=1e-3)


def test_at_rest_the_wires_share_the_torque():
    # With fingers that do not move, the motor stalls against its wires.
    drive, context = make(pwm=0.3)
    run(drive, context, 5.0)
    expected = [0.3 * CONFIG.full_wire_force] * 2
    assert read(drive, context, "wire_force") == pytest.approx(expected, rel=1e-3)


@given(ANGLES, ANGLES, st.floats(-1.0, 5.0))
def test_a_wire_only_pulls(base, tip, angle):
    drive, context = make(angle=angle, q=(base, base, tip, tip))
    stretch = CONFIG.spool_radius * angle - wire_travel(base, tip)
    expected = max(0.0, CONFIG.wire_stiffness * stretch)
    assert read(drive, context, "wire_force") == pytest.approx([expected] * 2)


SPEED = st.floats(-3.0, 3.0)


@given(st.tuples(*[ANGLES] * 4), st.tuples(*[SPEED] * 4), SPEED)
def test_wires_give_the_fingers_what_they_take_from_the_spool(q, v, speed):
    drive, context = make(angle=4.5, speed=speed, q=q, v=v)
    force = read(drive, context, "wire_force")
    assume(np.all(force > 0.0))
    springs = [CONFIG.base_spring] * 2 + [CONFIG.tip_spring] * 2
    back = [s.preload + s.stiffness * x for s, x in zip(springs, q, strict=True)]
    pulled = read(drive, context, "joint_torque") + back
    # Each wire shortens at the rate at which its finger takes it in.
    rate = [
        base_moment_arm(q[f]) * v[f] + tip_moment_arm(q[2 + f]) * v[2 + f]
        for f in range(2)
    ]
    assert pulled @ v == pytest.approx(force @ rate, abs=1e-9)


@given(st.tuples(*[ANGLES] * 4), SPEED)
def test_wires_brake_the_spool(q, speed):
    drive, context = make(angle=4.5, speed=speed, q=q)
    load = CONFIG.spool_radius * np.sum(read(drive, context, "wire_force"))
    update(drive, context)
    after = read(drive, context, "motor_state")[1]
    torque = -CONFIG.motor_damping * after - load
    expected = speed + PERIOD * torque / CONFIG.reflected_inertia
    assert after == pytest.approx(expected, abs=1e-9)


def test_slack_fingers_are_left_to_their_springs():
    drive, context = make(angle=-0.1)
    expected = [-CONFIG.base_spring.preload] * 2 + [-CONFIG.tip_spring.preload] * 2
    assert read(drive, context, "joint_torque") == pytest.approx(expected)


def test_free_closing_agrees_with_the_vendors_table():
    """The vendor's forces and angles leave no torque on a free joint."""
    rows = list(csv.DictReader(data.read_csv("tendon_free_closing.csv")))
    checked = 0
    for row in rows:
        force, base, tip = (float(value) for value in row.values())
        for q, arm, spring, limit in (
            (base, base_moment_arm, CONFIG.base_spring, 2.0068),
            (tip, tip_moment_arm, CONFIG.tip_spring, 1.7453),
        ):
            if 0.0 < q < limit:
                back = spring.preload + spring.stiffness * q
                assert force * arm(q) == pytest.approx(back, rel=0.01)
                checked += 1
    assert checked > 100


def table(joint):
    rows = csv.DictReader(data.read_csv("tendon_moment_arms.csv"))
    rows = [row for row in rows if row["joint"] == joint]
    return [
        np.array([float(r[k]) for r in rows]) for k in ("angle_rad", "moment_arm_m")
    ]


@pytest.mark.parametrize(
    ("joint", "arm"), [("base", base_moment_arm), ("tip", tip_moment_arm)]
)
def test_the_arms_are_those_of_the_vendors_table(joint, arm):
    angle, expected = table(joint)
    assert arm(angle) == pytest.approx(expected, rel=1e-3)


def test_the_travel_is_that_of_the_table():
    # From open to closed, the trapezium rule over the table gives 0.0291 m.
    expected = sum(np.trapezoid(*table(joint)[::-1]) for joint in ("base", "tip"))
    assert wire_travel(2.007129, 1.745329) == pytest.approx(expected, rel=1e-3)
    assert wire_travel(0.0, 0.0) == 0.0


@given(ANGLES, ANGLES)
def test_the_arms_are_the_derivatives_of_the_travel(base, tip):
    travel = wire_travel(AutoDiffXd(base, [1, 0]), AutoDiffXd(tip, [0, 1]))
    expected = [base_moment_arm(base), tip_moment_arm(tip)]
    assert travel.derivatives() == pytest.approx(expected, rel=1e-9)


STILL_PERIOD = 0.002
SPOOL_SPEED = st.floats(-10.0, 10.0)
SHARE = st.floats(0.0, 1.0)


@given(SPOOL_SPEED, st.floats(0.0, 10.0))
def test_friction_slows_down_but_never_turns(speed, most):
    after = reduce_magnitude(speed, most)
    assert after * speed >= 0.0
    assert abs(after) == pytest.approx(max(abs(speed) - most, 0.0))


@given(st.floats(-1.0, 1.0), st.floats(-0.01, 0.01))
def test_friction_of_a_wire_saturates_both_ways(state, travel):
    after = wire_slip(state, travel, 1e-4)
    assert -1.0 <= after <= 1.0
    assert (after - state) * travel >= 0.0


@given(SHARE, SHARE)
def test_what_a_wire_loses_one_way_it_gains_the_other(state, friction):
    assert transmitted_share(state, friction) <= 1.0
    product = transmitted_share(state, friction) * transmitted_share(-state, friction)
    assert product == pytest.approx(1.0)


@given(st.floats(0.0, 0.5), SHARE, SHARE, st.floats(0.0, 1.0))
def test_a_force_limit_gives_its_wire_force(band, gear, gear_load, share):
    friction = DriveFrictionConfig(gear=gear, gear_load=gear_load)
    drive = TendonDriveConfig(dead_band=band, friction=friction)
    force = share * drive.full_wire_force
    limit = drive.force_limit_of(force)
    assert 0.0 <= limit <= 1.0
    assert drive.wire_force_of(limit) == pytest.approx(force, abs=1e-6)


def still_drive(friction, *, angle=0.5, pwm=0.0, v=(0, 0, 0, 0), **changes):
    """A drive whose fingers do not move."""
    config = TendonDriveConfig(friction=friction, **changes)
    drive = TendonDrive(config, STILL_PERIOD)
    context = drive.CreateDefaultContext()
    place(context, angle)
    fix(drive, context, pwm=pwm, state_measured=[0, 0, 0, 0, *v])
    return drive, context


def place(context, angle):
    """Put the spool at rest, and leave the friction of the wires."""
    state = context.get_discrete_state_vector().CopyToVector()
    context.SetDiscreteState([angle, 0.0, *state[2:]])


def settle(drive, context, duration=3.0):
    for _ in range(round(duration / STILL_PERIOD)):
        update(drive, context)
    return read(drive, context, "wire_force")[0]


def test_gears_that_cannot_be_driven_back_keep_the_grip():
    drive, context = still_drive(DriveFrictionConfig(gear_load=1.0))
    before = read(drive, context, "wire_force")[0]
    assert before > 50.0
    assert settle(drive, context) == pytest.approx(before)
    assert settle(*still_drive(DriveFrictionConfig())) == pytest.approx(0.0, abs=0.1)


def test_the_gears_share_of_a_load_helps_to_hold_and_hinders_winding():
    pwm = 0.2
    friction = DriveFrictionConfig(gear=0.1, gear_load=0.5)
    torque = TendonDriveConfig().full_torque * pwm
    radius = TendonDriveConfig().spool_radius
    for angle, ends in ((0.0, (torque - 0.1) / 1.5), (0.9, (torque + 0.1) / 0.5)):
        drive, context = still_drive(friction, angle=angle, pwm=pwm)
        force = settle(drive, context, 4.0)
        assert 2.0 * radius * force == pytest.approx(ends, rel=0.02, abs=0.01)


@pytest.mark.parametrize("share", [0.5, 0.9, 1.1, 1.5])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_stiction_holds_a_resting_spool_beyond_the_friction_of_a_moving_one(
    share, side
):
    """The motor's torque differs from the load by a share of the stiction."""
    friction = DriveFrictionConfig(gear=0.1, gear_load=0.3, stiction=1.4)
    drive, context = still_drive(friction, angle=0.3)
    load = 2 * drive.config.spool_radius * read(drive, context, "wire_force")[0]
    torque = load + side * share * 1.4 * friction.gear_torque(load)
    fix(drive, context, pwm=torque / drive.config.full_torque)
    update(drive, context)
    _, speed = read(drive, context, "motor_state")
    assert (speed == 0.0) == (share < 1.0)
    assert speed * side >= 0.0


def test_stiction_changes_nothing_in_a_moving_spool():
    speeds = []
    for stiction in (1.0, 2.0):
        friction = DriveFrictionConfig(gear=0.1, gear_load=0.3, stiction=stiction)
        drive, context = still_drive(friction, pwm=0.1)
        context.SetDiscreteState([0.3, 2.0])
        update(drive, context)
        speeds.append(read(drive, context, "motor_state")[1])
    assert speeds[0] == speeds[1] > 0.0


def test_the_fingers_get_less_while_the_wire_winds_in_and_more_while_it_pays_out():
    torques = []
    for speed in (1.0, 0.0, -1.0):
        friction = DriveFrictionConfig(wire=0.2)
        drive, context = still_drive(friction, v=(speed,) * 4, wire_damping=0.0)
        for _ in range(50):  # 0.6 mm of travel
            update(drive, context)
        place(context, 0.5)
        torques.append(read(drive, context, "joint_torque")[0])
    spring = TendonDriveConfig().base_spring.preload
    ratios = (np.array(torques) + spring) / (torques[1] + spring)
    assert ratios == pytest.approx([np.exp(-0.2), 1.0, np.exp(0.2)])


def test_a_motor_gives_no_torque_in_its_dead_band():
    drive = TendonDriveConfig(dead_band=0.1)
    band = 0.1 / drive.full_scale
    assert drive.useful_pwm(0.99 * band) == 0.0
    assert drive.useful_pwm(-0.99 * band) == 0.0
    assert drive.useful_pwm(1.0 / drive.full_scale) == pytest.approx(
        1.0 / drive.full_scale
    )
    assert drive.useful_pwm(drive.pwm_of(0.3)) == pytest.approx(0.3)


DRIVE = TendonDriveConfig()
# A period so long that the motor settles within a few updates.
QUICK = MotorTemperatureConfig(period=2000.0)


def make_motor(pwm=0.0, speed=0.0, config=None):
    system = MotorTemperature(DRIVE, config)
    context = system.CreateDefaultContext()
    fix(system, context, pwm=pwm, motor_state=[0.3, speed])
    return system, context


def temperature(system, context, updates=1):
    for _ in range(updates):
        update(system, context)
    return read(system, context, "motor_temperature")[0]


def test_the_motor_starts_at_the_temperature_of_the_air():
    system, context = make_motor(pwm=1.0)
    assert read(system, context, "motor_temperature") == [25.0]


def test_a_stalled_motor_settles_where_the_air_takes_all_copper_loss():
    # At a fifth of the stall torque, 0.82 A flow through 12 V / 4.1 A, at 7.6 K/W.
    loss = 0.82**2 * 12.0 / 4.1
    settled = temperature(
        *make_motor(pwm=0.2 / DRIVE.full_scale, config=QUICK), updates=20
    )
    assert settled == pytest.approx(25.0 + 7.6 * loss)
    assert settled == pytest.approx(40.0, abs=0.1)


def test_the_first_rise_is_the_loss_over_the_heat_capacity():
    # In the first 0.1 s, the air takes nothing. All loss goes into 113 J/K.
    loss = DRIVE.full_scale**2 * 4.1 * 12.0
    rise = temperature(*make_motor(pwm=1.0)) - 25.0
    assert rise == pytest.approx(loss * 0.1 / 113.0, rel=1e-3)


def test_the_motor_cools_with_its_time_constant():
    config = MotorTemperatureConfig()
    system, context = make_motor(config=config)
    context.SetDiscreteState([80.0])
    cooled = temperature(system, context, updates=round(config.time_constant / 0.1))
    assert cooled - 25.0 == pytest.approx(55.0 / math.e, rel=1e-3)
    # Most of the heat is gone after the 20 minutes for which the manual asks to wait.
    assert 10 * 60 < config.time_constant < 20 * 60


def test_heat_comes_later_by_the_time_that_the_windings_take():
    slow = MotorTemperatureConfig(winding_time=10.0)
    # When most is in the housing, it lags by the mean of an exponential delay.
    late = temperature(*make_motor(pwm=1.0, config=slow), updates=600)
    early = temperature(*make_motor(pwm=1.0), updates=500)
    assert late == pytest.approx(early, rel=5e-3)
    settled = MotorTemperatureConfig(winding_time=10.0, period=2000.0)
    same = temperature(*make_motor(pwm=0.3, config=settled), updates=20)
    assert same == pytest.approx(
        temperature(*make_motor(0.3, config=QUICK), updates=20)
    )


def test_the_heat_of_the_windings_arrives_after_the_current_has_ended():
    system, context = make_motor(
        pwm=1.0, config=MotorTemperatureConfig(winding_time=10.0)
    )
    before = temperature(system, context, updates=50)
    fix(system, context, pwm=0.0)
    # 30 W for 5 s leave 12 W on the way, of which 47 J arrive in the next 5 s.
    after = temperature(system, context, updates=50)
    assert after - before == pytest.approx(47.0 / 113.0, rel=0.02)


def test_without_load_no_current_flows():
    speed = DRIVE.full_scale * DRIVE.no_load_speed
    assert motor_load(DRIVE, 1.0, speed) == pytest.approx(0.0)
    assert temperature(*make_motor(pwm=1.0, speed=speed)) == pytest.approx(25.0)


@given(st.floats(-1.0, 1.0), st.floats(-7.0, 7.0), st.floats(1e-3, 1e5))
def test_a_motor_never_cools_below_the_air(pwm, speed, period):
    config = MotorTemperatureConfig(period=period)
    assert temperature(*make_motor(pwm, speed, config), updates=3) >= 25.0
