import csv

import numpy as np
import pytest
from helpers import fix, read, update
from hypothesis import assume, given
from hypothesis import strategies as st
from pydrake.autodiffutils import AutoDiffXd
from pydrake.symbolic import Expression

from drake_srg.common.exceptions import ScenarioError
from drake_srg.gripper.tendon import (
    TendonDrive,
    TendonDrive_,
    TendonDriveConfig,
    base_moment_arm,
    tip_moment_arm,
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


@pytest.mark.parametrize("scalar", [AutoDiffXd, Expression])
def test_it_converts_to_other_scalars(scalar):
    drive = TendonDrive(CONFIG, PERIOD).ToScalarType[scalar]()
    assert isinstance(drive, TendonDrive_[scalar])
    assert drive.config is CONFIG


def test_the_joint_torque_has_a_gradient():
    drive = TendonDrive(CONFIG, PERIOD).ToAutoDiffXd()
    context = drive.CreateDefaultContext()
    context.SetDiscreteState([AutoDiffXd(1.0, [1.0]), AutoDiffXd(0.0)])
    fix(drive, context, state_measured=[AutoDiffXd(0.0)] * 8, pwm=[AutoDiffXd(0.0)])
    torque = drive.GetOutputPort("joint_torque").Eval(context)
    expected = CONFIG.wire_stiffness * CONFIG.spool_radius * base_moment_arm(0.0)
    assert torque[0].derivatives() == pytest.approx([expected])
