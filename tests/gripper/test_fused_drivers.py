import dataclasses as dc

import numpy as np
import pytest
from helpers import port_table

from drake_srg.common.fusing import FUSED
from drake_srg.common.joint_errors import JointErrorsConfig
from drake_srg.gripper.drivers import (
    LinkageDriver,
    PlantServoDriver,
    SrgPositionDriver,
    SrgTendonDriver,
)
from gripper import linkage_hand, srg_hand

ERRORS = JointErrorsConfig(latency=0.013, encoder_noise=1e-4)


@pytest.mark.parametrize("errors", [JointErrorsConfig(), ERRORS])
@pytest.mark.parametrize(
    ("make", "driver"),
    [
        (lambda config: srg_hand.Hand(post=True, config=config), SrgPositionDriver),
        (lambda config: srg_hand.Hand(post=True, config=config), SrgTendonDriver),
        (lambda config: srg_hand.Hand(post=True, config=config), PlantServoDriver),
        (lambda config: linkage_hand.Hand(radius=0.0125, config=config), LinkageDriver),
    ],
)
def test_a_fused_driver_gives_the_same_bits(make, driver, errors):
    config = driver(errors=errors, trigger="touch")
    wired, fused = make(config), make(dc.replace(config, fused=True))
    assert fused.driver.HasSubsystemNamed(FUSED)
    assert port_table(fused.driver) == port_table(wired.driver)
    vectors = [n for n, size in port_table(wired.driver)[1].items() if size]
    for closure, force_limit in ((0.6, 1.0), (0.6, 0.2), (0.3, np.nan)):
        for hand in (wired, fused):
            hand.command(closure_commanded=closure, force_limit=force_limit)
        for _ in range(12):
            for hand in (wired, fused):
                hand.simulator.AdvanceTo(hand.simulator.get_context().get_time() + 0.02)
            for name in vectors:
                assert fused.read(name).tobytes() == wired.read(name).tobytes(), name
