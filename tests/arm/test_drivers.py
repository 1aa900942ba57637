import dataclasses as dc

import numpy as np
import pytest
from helpers import fix, port_table
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant
from pydrake.multibody.plant import MultibodyPlantConfig as PlantConfig
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder

from drake_srg.arm.driver import AddArmDriver
from drake_srg.arm.drivers import ArmPositionDriver
from drake_srg.common.joint_errors import ArmErrorsConfig
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import AddDirectives

HOME = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.5, 0.0])
CONFIG = ArmPositionDriver(home=list(HOME))


def add_models(plant):
    AddDirectives(plant, load_scenario("kitchen"))
    return [plant.GetModelInstanceByName(name) for name in ("arm", "gripper")]


class Arm:
    """The driven arm, with a gripper whose fingers are limp."""

    def __init__(self, time_step=0.002, weightless=False, **errors):
        builder = DiagramBuilder()
        driven = dc.replace(
            CONFIG, errors=ArmErrorsConfig(**errors), weightless=weightless
        )
        config = PlantConfig(
            time_step=time_step, discrete_contact_approximation="lagged"
        )
        self.plant, _ = AddMultibodyPlant(config, builder)
        self.arm, gripper = add_models(self.plant)
        CONFIG.prepare_plant(self.plant, self.arm)
        self.plant.Finalize()
        self.plant.SetDefaultPositions(self.arm, HOME)
        control_plant = MultibodyPlant(0.0)
        add_models(control_plant)
        control_plant.Finalize()
        self.driver = AddArmDriver(
            builder, self.plant, self.arm, gripper, control_plant, driven
        )
        self.simulator = Simulator(builder.Build())
        if time_step == 0.0:
            cenic = SimulatorConfig(integration_scheme="cenic", max_step_size=0.005)
            ApplySimulatorConfig(cenic, self.simulator)
        self.root = self.simulator.get_mutable_context()
        self.context = self.driver.GetMyMutableContextFromRoot(self.root)
        plant_context = self.plant.GetMyMutableContextFromRoot(self.root)
        self.plant.get_actuation_input_port(gripper).FixValue(plant_context, [0.0] * 4)

    def command(self, q):
        fix(self.driver, self.context, position_commanded=q)

    @property
    def q(self):
        port = self.plant.get_state_output_port(self.arm)
        context = self.plant.GetMyContextFromRoot(self.root)
        return port.Eval(context)[:7].copy()


def test_ports():
    assert port_table(Arm().driver) == (
        {"position_commanded": 7, "arm_state": 14, "gripper_state": 8},
        {"desired_state": 14, "actuation": 7, "state_measured": 14},
    )


def test_a_weightless_arm_needs_torques_in_a_continuous_plant_alone():
    for time_step, actuated in ((0.002, False), (0.0, True)):
        driver = Arm(time_step, weightless=True).driver
        assert driver.HasOutputPort("actuation") == actuated
        assert driver.HasOutputPort("desired_state")


def test_it_holds_home_against_gravity():
    arm = Arm()
    arm.command(HOME)
    arm.simulator.AdvanceTo(1.0)
    # Without compensation, joint 2 would sag by some 60 N m / 9600 N m/rad.
    assert np.max(np.abs(arm.q - HOME)) < 1e-4


@pytest.mark.parametrize("time_step", [0.002, 0.0])
def test_it_follows_a_ramp_and_stays_at_its_end(time_step):
    arm = Arm(time_step)
    direction = np.array([0.3, 0.2, -0.3, 0.2, 0.3, -0.2, 0.3])
    lag = []
    for k in range(101):  # 0.5 s at up to 0.6 rad/s
        arm.command(HOME + direction * min(1.0, k / 100))
        arm.simulator.AdvanceTo(0.005 * (k + 1))
        lag.append(np.max(np.abs(arm.q - HOME - direction * k / 100)))
    # The controller sees each command one period late, 3 mrad at 0.6 rad/s. The first
    # motion from a standstill lags by at most twice that, because of damped inertia.
    assert max(lag) < 0.01
    arm.simulator.AdvanceTo(1.0)
    assert np.max(np.abs(arm.q - HOME - direction)) < 1e-3


def test_it_comes_to_rest_after_a_step():
    arm = Arm()
    arm.command(HOME)
    arm.simulator.AdvanceTo(0.1)
    arm.command(HOME + 0.02)
    arm.simulator.AdvanceTo(1.1)
    assert np.max(np.abs(arm.q - HOME - 0.02)) < 1e-3


def first_motion(**errors):
    """Return the time from a step of the command to the first motion [s]."""
    arm = Arm(**errors)
    arm.command(HOME)
    arm.simulator.AdvanceTo(0.1)
    arm.command(HOME + 0.02)
    for k in range(1, 60):
        arm.simulator.AdvanceTo(0.1 + 0.002 * k)
        if np.max(np.abs(arm.q - HOME)) > 1e-4:
            return 0.002 * k
    return np.inf


@pytest.mark.slow
def test_latency_delays_the_motion_and_noise_does_not():
    at_once = first_motion()
    assert first_motion(encoder_noise=1e-4) == at_once
    # The plant, with steps of 2 ms, sees an update of the driver at its next step.
    late = first_motion(latency=0.03) - at_once
    assert 0.03 - 1e-9 <= late <= 0.032 + 1e-9


def test_a_joint_stays_behind_by_half_its_backlash():
    arm = Arm(backlash=2e-3)
    arm.command(HOME)
    arm.simulator.AdvanceTo(0.1)
    arm.command(HOME + 0.02)
    arm.simulator.AdvanceTo(1.1)
    np.testing.assert_allclose(arm.q, HOME + 0.019, atol=2e-4)
    context = arm.driver.GetMyContextFromRoot(arm.root)
    measured = arm.driver.GetOutputPort("state_measured").Eval(context)[:7]
    np.testing.assert_allclose(measured, HOME + 0.02, atol=2e-4)


@pytest.mark.parametrize("name", ["kp", "kd", "home"])
def test_a_wrong_number_of_gains_is_named(name):
    plant = MultibodyPlant(0.001)
    arm, _ = add_models(plant)
    config = ArmPositionDriver(**{name: [1.0, 2.0]})
    with pytest.raises(ValueError, match=rf"arm\.{name}: needs one entry .* got 2"):
        config.prepare_plant(plant, arm)
