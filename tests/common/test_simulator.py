"""What a simulation computes from its state belongs to its present state."""

import pytest
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.simulator import MakeSimulator
from drake_srg.lifetime import LeafSystem

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
