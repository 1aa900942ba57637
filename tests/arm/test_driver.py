import dataclasses as dc

import numpy as np
import pytest
from helpers import fix
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    MultibodyPlant,
)
from pydrake.multibody.tree import RevoluteJoint, SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from arm.driven_arm import HOME, SCENARIO, DrivenArm
from drake_srg.arm import AddArmDriver, ArmPositionDriver, SafetyConfig
from drake_srg.arm.driver import (
    AddLinearInterpolation,
    GravityCompensation,
    SetInterpolatedPosition,
)
from drake_srg.arm.safety.limits import JointLimits
from drake_srg.common.joint_errors import ArmErrorsConfig
from drake_srg.station.plant import AddDirectives

COMMAND, STEP = 1 / 16, 1 / 64


class Interpolated:
    def __init__(self, start):
        builder = DiagramBuilder()
        self.system = AddLinearInterpolation(builder, np.array(start), COMMAND, STEP)
        builder.ExportInput(self.system.get_input_port(), "position")
        builder.ExportOutput(self.system.get_output_port(), "state")
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.context = self.simulator.get_mutable_context()

    def after(self, command, periods):
        """The output at every step of some periods with a command."""
        self.diagram.get_input_port().FixValue(self.context, command)
        steps, start = round(periods * COMMAND / STEP), self.context.get_time()
        rows = []
        for i in range(1, steps + 1):
            self.simulator.AdvanceTo(start + i * STEP)
            rows.append(self.diagram.get_output_port().Eval(self.context))
        return np.array(rows)


positions = st.lists(st.floats(-3.0, 3.0), min_size=2, max_size=2)


@settings(max_examples=20, deadline=None)
@given(start=positions, target=positions)
def test_it_moves_evenly_to_the_command_and_stays(start, target):
    arm = Interpolated(start)
    assert np.allclose(arm.diagram.get_output_port().Eval(arm.context)[:2], start)
    rows = arm.after(target, 3)
    assert np.allclose(rows[-1], [*target, 0.0, 0.0])
    low, high = np.minimum(start, target) - 1e-9, np.maximum(start, target) + 1e-9
    assert np.all((rows[:, :2] >= low) & (rows[:, :2] <= high))
    speed = np.diff(rows[:, :2], axis=0) / STEP
    moving = np.abs(speed).max(axis=1) > 1e-9
    assert np.allclose(speed[moving], np.subtract(target, start) / COMMAND)


def test_it_can_be_put_at_rest_anywhere():
    arm = Interpolated([0.0, 0.0])
    arm.after([1.0, 2.0], 1.5)
    SetInterpolatedPosition(arm.system, arm.context, np.array([0.5, -0.5]))
    state = arm.diagram.get_output_port().Eval(arm.context)
    assert np.array_equal(state, [0.5, -0.5, 0.0, 0.0])


@pytest.mark.parametrize(("command", "step"), [(0.05, 0.0015), (0.06, 0.004), (0.1, 1)])
def test_commands_between_steps_are_refused(command, step):
    with pytest.raises(ValueError, match=r"must be a multiple of arm\.period"):
        AddLinearInterpolation(DiagramBuilder(), np.zeros(2), command, step)


def test_the_compensation_agrees_with_the_plants_gravity():
    plant = MultibodyPlant(0.0)
    AddDirectives(plant, SCENARIO)
    plant.Finalize()
    arm, gripper = (plant.GetModelInstanceByName(name) for name in ("arm", "gripper"))
    system = GravityCompensation(plant, ["arm", "gripper"])
    context, plant_context = system.CreateDefaultContext(), plant.CreateDefaultContext()
    generator = np.random.default_rng(0)
    for _ in range(5):
        q, fingers = generator.uniform(-1.5, 1.5, 7), generator.uniform(0, 1.5, 4)
        fix(
            system,
            context,
            arm_state=np.concatenate([q, generator.normal(size=7)]),
            gripper_state=np.concatenate([fingers, generator.normal(size=4)]),
        )
        plant.SetPositions(plant_context, arm, q)
        plant.SetPositions(plant_context, gripper, fingers)
        # The gradient of the potential energy, by central differences.
        expected = np.zeros(7)
        for i in range(7):
            energy = []
            for h in (1e-5, -1e-5):
                plant.SetPositions(plant_context, arm, q + h * np.eye(7)[i])
                energy.append(plant.CalcPotentialEnergy(plant_context))
            expected[i] = (energy[0] - energy[1]) / 2e-5
        result = system.get_output_port().Eval(context)
        np.testing.assert_allclose(result, expected, atol=1e-5)
        assert np.max(np.abs(result)) > 1.0


CONFIG = ArmPositionDriver(home=list(HOME))


class Arm(DrivenArm):
    """The stiff arm, with errors of its encoders and joints."""

    def __init__(self, time_step=0.002, weightless=False, **errors):
        config = dc.replace(
            CONFIG, errors=ArmErrorsConfig(**errors), weightless=weightless
        )
        super().__init__(config, time_step)


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
    measured = arm.driver.GetOutputPort("state_measured").Eval(arm.context)[:7]
    np.testing.assert_allclose(measured, HOME + 0.02, atol=2e-4)


@pytest.mark.parametrize("name", ["kp", "kd", "home"])
def test_a_wrong_number_of_gains_is_named(name):
    plant = MultibodyPlant(0.001)
    AddDirectives(plant, SCENARIO)
    arm = plant.GetModelInstanceByName("arm")
    config = ArmPositionDriver(**{name: [1.0, 2.0]})
    with pytest.raises(ValueError, match=rf"arm\.{name}: needs one entry .* got 2"):
        config.prepare_plant(plant, arm)


class Pendulum:
    """One arm or two of a single joint, next to a free body."""

    def __init__(self, names=("arm",), *, prepare=True, effort=100.0, **config):
        self.config = ArmPositionDriver(home=[0.3], **config)
        builder = DiagramBuilder()
        self.plant, _ = AddMultibodyPlantSceneGraph(builder, 0.002)
        add_free_body(self.plant)
        arms = [add_pendulum(self.plant, name, effort) for name in names]
        for arm in arms:
            if prepare:
                self.config.prepare_plant(self.plant, arm)
        self.plant.Finalize()
        control_plant = MultibodyPlant(0.0)
        for name in names:
            add_pendulum(control_plant, name, effort)
        control_plant.Finalize()
        self.drivers = [
            AddArmDriver(
                builder,
                self.plant,
                arm,
                None,
                control_plant,
                self.config,
                name=f"{name}_driver",
            )
            for arm, name in zip(arms, names, strict=True)
        ]
        self.simulator = Simulator(builder.Build())
        self.root = self.simulator.get_mutable_context()

    def angle(self, name):
        context = self.plant.GetMyContextFromRoot(self.root)
        model = self.plant.GetModelInstanceByName(name)
        return self.plant.GetPositions(context, model)[0]


def add_free_body(plant):
    body = plant.AddRigidBody("ball", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    plant.SetDefaultFloatingBaseBodyPose(body, RigidTransform([5.0, 0.0, 0.0]))


def add_pendulum(plant, name, effort):
    """A mass of 2 kg, half a metre from a horizontal axis."""
    model = plant.AddModelInstance(name)
    inertia = SpatialInertia(2.0, [0.5, 0.0, 0.0], UnitInertia(0.0, 0.25, 0.25))
    body = plant.AddRigidBody("link", model, inertia)
    joint = RevoluteJoint(
        "joint", plant.world_frame(), body.body_frame(), [0, 1, 0], -1.0, 2.0
    )
    plant.AddJoint(joint).set_acceleration_limits([-8.0], [8.0])
    joint = plant.GetJointByName("joint", model)
    joint.set_velocity_limits([-3.0], [3.0])
    plant.AddJointActuator("motor", joint, effort)
    return model


def test_two_arms_start_at_home_and_stay_there_in_one_diagram():
    arms = Pendulum(["left", "right"])
    for driver, q in zip(arms.drivers, (0.3, 0.5), strict=True):
        context = driver.GetMyMutableContextFromRoot(arms.root)
        fix(driver, context, position_commanded=[q])
    arms.simulator.AdvanceTo(0.01)
    assert [arms.angle("left"), arms.angle("right")] == pytest.approx(
        [0.3] * 2, abs=0.1
    )
    arms.simulator.AdvanceTo(1.0)
    assert arms.angle("left") == pytest.approx(0.3, abs=1e-4)
    assert arms.angle("right") == pytest.approx(0.5, abs=1e-4)


def test_a_name_that_is_taken_is_refused():
    arm = Pendulum()
    builder = DiagramBuilder()
    builder.AddNamedSystem("arm_driver", ConstantVectorSource([0.0]))
    model = arm.plant.GetModelInstanceByName("arm")
    with pytest.raises(ValueError, match=r"^arm_driver: the diagram already has a"):
        AddArmDriver(builder, arm.plant, model, None, arm.plant, arm.config)


def test_an_arm_whose_plant_is_not_prepared_is_refused():
    with pytest.raises(
        ValueError, match=r"^arm: actuator motor has no gains: call the"
    ):
        Pendulum(prepare=False)
    with pytest.raises(ValueError, match=r"^arm: has weight: call the configuration"):
        Pendulum(prepare=False, weightless=True)


@pytest.mark.parametrize(("effort", "kp"), [(100.0, 0.5 * 40.0**2), (2.0, 200.0)])
def test_gains_come_from_inertia_and_torque(effort, kp):
    arm = Pendulum(effort=effort)
    model = arm.plant.GetModelInstanceByName("arm")
    (actuator,) = (
        arm.plant.get_joint_actuator(i)
        for i in arm.plant.GetJointActuatorIndices(model)
    )
    gains = actuator.get_controller_gains()
    assert gains.p == pytest.approx(kp)
    assert gains.d == pytest.approx(2.0 * np.sqrt(kp * 0.5))  # 2 kg, 0.5 m


def test_gains_that_are_given_stay():
    arm = Pendulum(kp=[50.0])
    model = arm.plant.GetModelInstanceByName("arm")
    (index,) = arm.plant.GetJointActuatorIndices(model)
    gains = arm.plant.get_joint_actuator(index).get_controller_gains()
    assert gains.p == 50.0
    assert gains.d == pytest.approx(2.0 * 0.5 * 40.0)


def test_a_weightless_arm_stays_where_it_is():
    arm = Pendulum(weightless=True, kp=[0.0], kd=[0.0])
    (driver,) = arm.drivers
    fix(
        driver,
        driver.GetMyMutableContextFromRoot(arm.root),
        position_commanded=[0.3],
    )
    arm.simulator.AdvanceTo(0.5)
    assert arm.angle("arm") == pytest.approx(0.3, abs=1e-9)


def test_limits_of_an_arm_next_to_a_free_body_are_its_own():
    arm = Pendulum()
    model = arm.plant.GetModelInstanceByName("arm")
    limits = JointLimits.of_plant(arm.plant, model, SafetyConfig(), 0.01)
    assert (limits.lower, limits.upper) == ([-1.0], [2.0])
    assert limits.step == pytest.approx([0.03], rel=0.01)
