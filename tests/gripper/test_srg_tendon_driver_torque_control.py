import dataclasses as dc

import numpy as np
import pytest
from helpers import fix, read, update

from drake_srg.gripper.srg_tendon_driver import TorqueControl
from drake_srg.gripper.tendon import TendonDriveConfig

PERIOD = 0.005
SLOW = TendonDriveConfig(dead_band=0.1, torque_rise=0.1)


def control(drive, torque, updates=1):
    system = TorqueControl(drive, PERIOD)
    context = system.CreateDefaultContext()
    fix(system, context, torque_desired=torque)
    for _ in range(updates):
        update(system, context)
    return system, context, read(system, context, "pwm_desired")[0]


@pytest.mark.parametrize("torque", [-0.8, -0.1, 0.3, 0.8])
def test_it_finds_the_pwm_that_gives_the_torque(torque):
    drive = TendonDriveConfig(dead_band=0.1)
    fast = dc.replace(drive, torque_rise=0.1 * PERIOD)
    for model, updates in ((drive, 1), (fast, 30), (SLOW, 300)):
        pwm = control(model, torque, updates)[2]
        assert model.useful_pwm(pwm) == pytest.approx(torque, abs=1e-3)


def test_it_rises_from_zero_at_the_rate_of_what_is_missing():
    assert control(SLOW, 0.5)[2] == pytest.approx(0.5 * PERIOD / 0.1)


def test_position_control_passes_and_resets_it():
    system, context, _ = control(SLOW, 0.5, 100)
    fix(system, context, torque_desired=np.nan)
    update(system, context)
    assert np.isnan(read(system, context, "pwm_desired")[0])
    fix(system, context, torque_desired=0.5)
    update(system, context)
    assert read(system, context, "pwm_desired")[0] == pytest.approx(0.025)
