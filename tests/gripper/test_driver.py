import dataclasses as dc
from typing import ClassVar

import numpy as np
import pytest
from helpers import port_table
from pydrake.systems.primitives import MatrixGain

from drake_srg.common.joint_errors import JointErrorsConfig
from drake_srg.gripper.driver import GripperControl, GripperDriver
from drake_srg.gripper.drivers import DRIVERS, SrgPositionDriver, SrgTendonDriver
from drake_srg.gripper.sensors import SRG_FINGERS, FingerLayout
from drake_srg.gripper.servo import GripperServoConfig
from gripper.srg_hand import Hand


@dc.dataclass(kw_only=True)
class TorqueDriver(GripperDriver):
    """The least that a driver is: closure 1 is 0.1 N m at each joint."""

    layout: ClassVar[FingerLayout] = SRG_FINGERS
    servo: GripperServoConfig = dc.field(
        default_factory=lambda: SrgPositionDriver().servo
    )

    def AddControl(self, inner, plant, gripper, sensing):
        torques = inner.AddNamedSystem("torques", MatrixGain(np.full((4, 1), 0.1)))
        return GripperControl(
            {"closure_commanded": torques.get_input_port()},
            {"actuation": torques.get_output_port()},
        )


def test_a_driver_is_its_control_and_sensors():
    inputs, outputs = port_table(Hand(config=TorqueDriver()).driver)
    ours = port_table(Hand(config=SrgPositionDriver()).driver)
    assert ours[0].items() - inputs.items() == {
        ("joint_position_commanded", 4),
        ("hold", 1),
        ("force_limit", 1),
    }
    assert ours[1].items() - outputs.items() == {("pwm", 4)}
    assert not inputs.keys() - ours[0].keys()


def test_the_control_drives_the_plant():
    hand = Hand(config=TorqueDriver())
    hand.command(closure_commanded=0.5)
    hand.simulator.AdvanceTo(0.02)
    net = hand.plant.get_net_actuation_output_port(hand.model)
    context = hand.plant.GetMyContextFromRoot(hand.root)
    assert net.Eval(context) == pytest.approx([0.05] * 4)


def test_every_driver_has_the_latency_of_its_configuration():
    errors = JointErrorsConfig(latency=0.05)
    hand = Hand(config=TorqueDriver(errors=errors))
    hand.simulator.AdvanceTo(0.05)
    hand.command(closure_commanded=1.0)
    hand.simulator.AdvanceTo(0.09)
    assert hand.read("actuation") == pytest.approx([0.0] * 4)
    hand.simulator.AdvanceTo(0.11)
    assert hand.read("actuation") == pytest.approx([0.1] * 4)


@pytest.mark.parametrize("driver", DRIVERS)
def test_a_motor_has_an_entry_in_every_gain(driver):
    config = driver()
    for gain in ("kp", "ki", "kd", "kff1", "kff2"):
        assert len(getattr(config.servo, gain)) == config.num_motors


def test_one_motor_winds_the_wires_of_the_tendon_driver_alone():
    tendon = SrgTendonDriver()
    assert tendon.num_motors == 1
    assert tendon.wire_motor.drive is tendon.drive
    others = [driver() for driver in DRIVERS if driver is not SrgTendonDriver]
    assert [driver.wire_motor for driver in others] == [None] * len(others)


def test_wires_need_a_plant_with_steps():
    needing = [driver for driver in DRIVERS if driver.needs_discrete_plant]
    assert needing == [SrgTendonDriver]
