"""A simulation never uses values computed from an earlier state."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    AddMultibodyPlantSceneGraph,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import PdControllerGains, PrismaticJoint, SpatialInertia
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Gain, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.common.systems import (
    AddVelocityFeedforward,
    MakeSimulator,
    contact_approximations,
    export_outputs,
    input_ports,
    marks_fixed_steps,
    output_ports,
    takes_loop_constraints,
    takes_nested_plant,
)
from drake_srg.lifetime import LeafSystem


@pytest.mark.parametrize(
    "takes", [takes_nested_plant, takes_loop_constraints, marks_fixed_steps]
)
@pytest.mark.parametrize(
    ("version", "newer"),
    [("1.51.1", False), ("1.58.0", True), ("1.100.0", True), ("2.0.0", True)],
)
def test_cenic_depends_on_the_version_of_drake(monkeypatch, takes, version, newer):
    monkeypatch.setattr("importlib.metadata.version", lambda name: version)
    assert takes() is newer


def test_drake_takes_every_contact_approximation_that_is_listed():
    names = contact_approximations()
    assert {"lagged", "sap", "similar"} <= set(names)
    for name in names:
        config = MultibodyPlantConfig(
            time_step=0.005, discrete_contact_approximation=name
        )
        plant, _ = AddMultibodyPlant(config, DiagramBuilder())
        assert plant.time_step() == 0.005


STEP = 1.0 / 64.0


class HeightSampler(LeafSystem):
    """Samples the height of a plant's last body at the start of each step."""

    def __init__(self):
        super().__init__()
        self.heights = []
        self.DeclareAbstractInputPort("body_poses", Value([RigidTransform()]))
        self.DeclarePeriodicUnrestrictedUpdateEvent(STEP, 0.0, self._sample)

    def _sample(self, context, state):
        (_, X_WB) = self.get_input_port().Eval(context)
        self.heights.append(X_WB.translation()[2])


@pytest.mark.parametrize("use_error_control", [False, True])
def test_poses_belong_to_the_present_state(use_error_control):
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.0)
    plant.set_name("plant")
    body = plant.AddRigidBody("ball", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    plant.Finalize()
    sampler = builder.AddSystem(HeightSampler())
    builder.Connect(plant.get_body_poses_output_port(), sampler.get_input_port())
    config = SimulatorConfig(
        integration_scheme="cenic",
        max_step_size=STEP,
        use_error_control=use_error_control,
    )
    simulator = MakeSimulator(builder.Build(), config)
    context = plant.GetMyContextFromRoot(simulator.get_context())
    truth = []
    for k in range(1, 9):
        truth.append(plant.GetPositions(context)[-1])
        simulator.AdvanceTo(k * STEP)
        height = plant.EvalBodyPoseInWorld(context, body).translation()[2]
        assert height == plant.GetPositions(context)[-1] < truth[-1]
    assert sampler.heights == truth


def gain_diagram():
    builder = DiagramBuilder()
    gain = builder.AddSystem(Gain(2.0, 1))
    builder.ExportInput(gain.get_input_port(), "torque")
    builder.ExportOutput(gain.get_output_port(), "speed")
    builder.ExportOutput(gain.get_output_port(), "speed_again")
    return builder.Build()


def test_ports_are_listed_by_name_in_their_order():
    diagram = gain_diagram()
    assert list(input_ports(diagram)) == ["torque"]
    assert list(output_ports(diagram)) == ["speed", "speed_again"]
    assert output_ports(diagram)["speed"].get_index() == 0


def test_all_outputs_are_exported_under_their_own_names():
    builder = DiagramBuilder()
    inner = builder.AddSystem(gain_diagram())
    builder.ExportInput(inner.get_input_port(), "torque")
    export_outputs(builder, inner)
    outer = builder.Build()
    context = outer.CreateDefaultContext()
    outer.GetInputPort("torque").FixValue(context, [3.0])
    assert list(output_ports(outer)) == ["speed", "speed_again"]
    assert outer.GetOutputPort("speed_again").Eval(context) == np.array([6.0])


KP, KD, SPEED, PERIOD = 1600.0, 80.0, 0.05, 0.001


def lag(scheme, split):
    """Return how far a joint of 1 kg is behind a constant speed [s]."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.0)
    body = plant.AddRigidBody("body", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    joint = plant.AddJoint(
        PrismaticJoint("joint", plant.world_frame(), body.body_frame(), [1, 0, 0])
    )
    plant.AddJointActuator("actuator", joint).set_controller_gains(
        PdControllerGains(p=KP, d=KD)
    )
    plant.Finalize()
    ramp = PiecewisePolynomial.FirstOrderHold([0.0, 10.0], [[0.0, 10.0 * SPEED]])
    source = builder.AddSystem(TrajectorySource(ramp, output_derivative_order=1))
    desired, model = source.get_output_port(), body.model_instance()
    if split:
        desired, torque = AddVelocityFeedforward(builder, desired, np.array([KD]))
        builder.Connect(torque, plant.get_actuation_input_port(model))
    builder.Connect(desired, plant.get_desired_state_input_port(model))
    simulator = Simulator(builder.Build())
    config = SimulatorConfig(
        integration_scheme=scheme, max_step_size=PERIOD, accuracy=1e-6
    )
    ApplySimulatorConfig(config, simulator)
    simulator.AdvanceTo(1.0)
    context = plant.GetMyContextFromRoot(simulator.get_context())
    assert joint.get_translation_rate(context) == pytest.approx(SPEED, rel=1e-3)
    return 1.0 - joint.get_translation(context) / SPEED


@pytest.mark.parametrize("scheme", ["cenic", "implicit_euler", "runge_kutta3"])
def test_a_joint_keeps_up_with_its_desired_velocity(scheme):
    assert abs(lag(scheme, split=True)) < 2 * PERIOD


def test_cenic_alone_takes_the_velocity_with_the_opposite_sign():
    # If this fails, Drake has changed, and the split can go.
    assert lag("cenic", split=False) == pytest.approx(2 * KD / KP, abs=2 * PERIOD)
