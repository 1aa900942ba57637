import csv

import numpy as np
import pytest
from helpers import fix, read, update
from hypothesis import given
from hypothesis import strategies as st
from pydrake.autodiffutils import AutoDiffXd
from pydrake.symbolic import Expression

from drake_srg.gripper.tendon import (
    DriveFrictionConfig,
    TendonDrive,
    TendonDrive_,
    TendonDriveConfig,
    base_moment_arm,
    reduce_magnitude,
    tip_moment_arm,
    transmitted_share,
    wire_slip,
    wire_travel,
)
from experiments import data

ANGLES = st.floats(0.0, 1.745)


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


PERIOD = 0.002
SPEED = st.floats(-10.0, 10.0)
SHARE = st.floats(0.0, 1.0)


@given(SPEED, st.floats(0.0, 10.0))
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


def make(friction, *, angle=0.5, pwm=0.0, v=(0, 0, 0, 0), **changes):
    """A drive whose fingers do not move."""
    config = TendonDriveConfig(friction=friction, **changes)
    drive = TendonDrive(config, PERIOD)
    context = drive.CreateDefaultContext()
    place(context, angle)
    fix(drive, context, pwm=pwm, state_measured=[0, 0, 0, 0, *v])
    return drive, context


def place(context, angle):
    """Put the spool at rest, and leave the friction of the wires."""
    state = context.get_discrete_state_vector().CopyToVector()
    context.SetDiscreteState([angle, 0.0, *state[2:]])


def settle(drive, context, duration=3.0):
    for _ in range(round(duration / PERIOD)):
        update(drive, context)
    return read(drive, context, "wire_force")[0]


def test_gears_that_cannot_be_driven_back_keep_the_grip():
    drive, context = make(DriveFrictionConfig(gear_load=1.0))
    before = read(drive, context, "wire_force")[0]
    assert before > 50.0
    assert settle(drive, context) == pytest.approx(before)
    assert settle(*make(DriveFrictionConfig())) == pytest.approx(0.0, abs=0.1)


def test_the_gears_share_of_a_load_helps_to_hold_and_hinders_winding():
    pwm = 0.2
    friction = DriveFrictionConfig(gear=0.1, gear_load=0.5)
    torque = TendonDriveConfig().full_torque * pwm
    radius = TendonDriveConfig().spool_radius
    for angle, ends in ((0.0, (torque - 0.1) / 1.5), (0.9, (torque + 0.1) / 0.5)):
        drive, context = make(friction, angle=angle, pwm=pwm)
        force = settle(drive, context, 4.0)
        assert 2.0 * radius * force == pytest.approx(ends, rel=0.02, abs=0.01)


@pytest.mark.parametrize("share", [0.5, 0.9, 1.1, 1.5])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_stiction_holds_a_resting_spool_beyond_the_friction_of_a_moving_one(
    share, side
):
    """The motor's torque differs from the load by a share of the stiction."""
    friction = DriveFrictionConfig(gear=0.1, gear_load=0.3, stiction=1.4)
    drive, context = make(friction, angle=0.3)
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
        drive, context = make(friction, pwm=0.1)
        context.SetDiscreteState([0.3, 2.0])
        update(drive, context)
        speeds.append(read(drive, context, "motor_state")[1])
    assert speeds[0] == speeds[1] > 0.0


def test_the_fingers_get_less_while_the_wire_winds_in_and_more_while_it_pays_out():
    torques = []
    for speed in (1.0, 0.0, -1.0):
        friction = DriveFrictionConfig(wire=0.2)
        drive, context = make(friction, v=(speed,) * 4, wire_damping=0.0)
        for _ in range(50):  # 0.6 mm of travel
            update(drive, context)
        place(context, 0.5)
        torques.append(read(drive, context, "joint_torque")[0])
    spring = TendonDriveConfig().base_spring.preload
    ratios = (np.array(torques) + spring) / (torques[1] + spring)
    assert ratios == pytest.approx([np.exp(-0.2), 1.0, np.exp(0.2)])


@pytest.mark.parametrize("scalar", [AutoDiffXd, Expression])
def test_a_drive_with_friction_converts_to_other_scalars(scalar):
    friction = DriveFrictionConfig(gear=0.1, gear_load=0.5, stiction=1.3, wire=0.1)
    drive = TendonDrive(TendonDriveConfig(friction=friction, dead_band=0.1), PERIOD)
    other = drive.ToScalarType[scalar]()
    assert isinstance(other, TendonDrive_[scalar])
    context = other.CreateDefaultContext()
    fix(other, context, pwm=[scalar(0.5)], state_measured=[scalar(0.0)] * 8)
    update(other, context)
    assert other.GetOutputPort("motor_state").Eval(context)[1] is not None


def test_a_motor_gives_no_torque_in_its_dead_band():
    drive = TendonDriveConfig(dead_band=0.1)
    band = 0.1 / drive.full_scale
    assert drive.useful_pwm(0.99 * band) == 0.0
    assert drive.useful_pwm(-0.99 * band) == 0.0
    assert drive.useful_pwm(1.0 / drive.full_scale) == pytest.approx(
        1.0 / drive.full_scale
    )
    assert drive.useful_pwm(drive.pwm_of(0.3)) == pytest.approx(0.3)
