import numpy as np
import pytest
from helpers import fix
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import AddMultibodyPlant, ExternallyAppliedSpatialForce
from pydrake.multibody.plant import MultibodyPlantConfig as PlantConfig
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.arm.driver import AddArmDriver
from drake_srg.arm.drivers import ArmPositionDriver
from drake_srg.arm.external_torque import (
    TIME_CONSTANT,
    AddExternalTorque,
    ExternalTorqueObserver,
    lag_share,
)
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import AddDirectives, MakeModelsPlant

HOME = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.5, 0.0])
CONFIG = ArmPositionDriver(home=list(HOME))
SCENARIO = load_scenario("kitchen")


class Arm:
    """The driven arm with limp fingers and an observer of its external torques.

    It moves by `turn` (7) [rad] from home within a second.
    """

    def __init__(self, turn=0.0 * HOME, time_step=0.002):
        builder = DiagramBuilder()
        config = PlantConfig(
            time_step=time_step, discrete_contact_approximation="lagged"
        )
        self.plant, _ = AddMultibodyPlant(config, builder)
        AddDirectives(self.plant, SCENARIO)
        self.arm, gripper = (
            self.plant.GetModelInstanceByName(name) for name in ("arm", "gripper")
        )
        CONFIG.prepare_plant(self.plant, self.arm)
        self.plant.Finalize()
        self.plant.SetDefaultPositions(self.arm, HOME)
        models = MakeModelsPlant(SCENARIO)
        driver = AddArmDriver(builder, self.plant, self.arm, gripper, models, CONFIG)
        path = PiecewisePolynomial.CubicWithContinuousSecondDerivatives(
            [0.0, 0.5, 1.0],
            np.column_stack([HOME, HOME + 0.5 * turn, HOME + turn]),
            np.zeros((7, 1)),
            np.zeros((7, 1)),
        )
        source = builder.AddSystem(TrajectorySource(path))
        builder.Connect(
            source.get_output_port(), driver.GetInputPort("position_commanded")
        )
        port = AddExternalTorque(
            builder, self.plant, self.arm, gripper, models, CONFIG.period
        )
        builder.ExportOutput(port, "external_torque")
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.root = self.simulator.get_mutable_context()
        self.context = self.plant.GetMyMutableContextFromRoot(self.root)
        self.plant.get_actuation_input_port(gripper).FixValue(self.context, [0.0] * 4)

    def push(self, force, torque=(0.0, 0.0, 0.0)):
        """Apply a force [N] and a torque [N m], in world, at the palm's origin.

        Returns:
            The joint torques that they cause, shape (7,) [N m].
        """
        palm = self.plant.GetBodyByName("palm")
        applied = ExternallyAppliedSpatialForce()
        applied.body_index = palm.index()
        applied.F_Bq_W = SpatialForce(tau=torque, f=force)
        self.plant.get_applied_spatial_force_input_port().FixValue(
            self.context, [applied]
        )
        world = self.plant.world_frame()
        J = self.plant.CalcJacobianSpatialVelocity(
            self.context, JacobianWrtVariable.kV, palm.body_frame(), np.zeros(3),
            world, world,
        )  # fmt: skip
        return self.plant.GetVelocitiesFromArray(
            self.arm, J.T @ np.concatenate([torque, force])
        )

    @property
    def external(self):
        return self.diagram.GetOutputPort("external_torque").Eval(self.root).copy()

    @property
    def applied(self):
        port = self.plant.get_net_actuation_output_port(self.arm)
        return port.Eval(self.context).copy()


def test_an_arm_at_rest_feels_nothing():
    arm = Arm()
    arm.simulator.AdvanceTo(0.5)
    # Gravity takes 50 N m. The limp fingers swing a little.
    assert np.max(np.abs(arm.external)) < 0.1


@pytest.mark.parametrize(
    ("force", "torque"),
    [([30.0, 0.0, 0.0], [0.0] * 3), ([0.0, -20.0, -15.0], [0.0, 3.0, 2.0])],
)
def test_a_push_is_felt_as_its_torques(force, torque):
    arm = Arm()
    arm.simulator.AdvanceTo(0.3)
    expected = arm.push(force, torque)
    assert np.max(np.abs(expected)) > 5.0
    arm.simulator.AdvanceTo(0.8)
    # The stiff arm gives way by less than 1 mm and 0.1 degrees.
    np.testing.assert_allclose(arm.external, expected, atol=0.3)


def test_the_torques_follow_with_the_lag():
    arm = Arm()
    arm.simulator.AdvanceTo(0.3)
    expected = arm.push([30.0, 0.0, 0.0])
    arm.simulator.AdvanceTo(0.3 + TIME_CONSTANT + CONFIG.period)
    joint = int(np.argmax(np.abs(expected)))
    # 1 - 1/e after the time constant and at most one period more; the stiff arm swings
    # at first.
    share = arm.external[joint] / expected[joint]
    assert 0.5 < share < 0.9
    assert lag_share(TIME_CONSTANT) == pytest.approx(1.0 - np.exp(-1.0))


@pytest.mark.parametrize("time_step", [0.001, 0.004])
def test_free_motion_is_not_taken_for_a_push(time_step):
    turn = np.array([1.0, 0.5, -0.5, 0.7, 0.4, -0.6, 0.8])
    arm = Arm(turn=turn, time_step=time_step)
    most, torque = np.zeros(7), np.zeros(7)
    for time in np.arange(0.02, 1.2, 0.01):
        arm.simulator.AdvanceTo(time)
        most = np.maximum(most, np.abs(arm.external))
        torque = np.maximum(torque, np.abs(arm.applied))
    assert np.max(torque) > 50.0
    # A hundredth of the motors' torque, whatever the number of steps per period.
    assert np.max(most) < 0.5


def test_an_observer_without_a_gripper_has_all_state_in_its_context():
    plant = MakeModelsPlant(load_scenario("assistive_arm"))
    observer = ExternalTorqueObserver(plant, ["arm"], 0.01)
    context, other = observer.CreateDefaultContext(), observer.CreateDefaultContext()
    simulator = Simulator(observer, context)
    fix(observer, context, arm_state=np.zeros(10), torque=np.full(5, 0.3))
    simulator.AdvanceTo(0.2)
    assert np.any(observer.get_output_port().Eval(context))
    np.testing.assert_array_equal(observer.get_output_port().Eval(other), 0.0)


def test_a_continuous_plant_gets_torques_from_contacts_alone():
    arm = Arm(time_step=0.0)
    context = arm.diagram.CreateDefaultContext()
    np.testing.assert_array_equal(
        arm.diagram.GetOutputPort("external_torque").Eval(context), 0.0
    )
    assert not arm.diagram.HasSubsystemNamed("external_torque_observer")
