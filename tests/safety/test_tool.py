import numpy as np
import pytest
from pydrake.multibody.tree import JacobianWrtVariable

from drake_srg.safety.tool import Tool
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import MakeModelsPlant

Q = np.array([0.1, 0.4, -0.2, -1.3, 0.2, 0.9, 0.3])


@pytest.fixture(scope="module")
def plant():
    return MakeModelsPlant(load_scenario("kitchen", seed=0))


@pytest.fixture(scope="module")
def tool(plant):
    return Tool(plant, "arm", "gripper::grasp_center")


def test_its_position_is_that_of_the_frame(plant, tool):
    context = plant.CreateDefaultContext()
    arm = plant.GetModelInstanceByName("arm")
    plant.SetPositions(context, arm, Q)
    frame = plant.GetFrameByName("grasp_center")
    np.testing.assert_allclose(
        tool.position(Q), frame.CalcPoseInWorld(context).translation(), atol=1e-15
    )


def test_it_finds_the_force_that_causes_torques(plant, tool):
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, plant.GetModelInstanceByName("arm"), Q)
    world, frame = plant.world_frame(), plant.GetFrameByName("grasp_center")
    J = plant.CalcJacobianTranslationalVelocity(
        context, JacobianWrtVariable.kV, frame, np.zeros(3), world, world
    )
    arm = plant.GetModelInstanceByName("arm")
    force = np.array([10.0, -20.0, 5.0])
    torque = plant.GetVelocitiesFromArray(arm, J.T @ force)
    assert tool.force(Q, torque) == pytest.approx(np.linalg.norm(force))


@pytest.mark.parametrize("name", ["grasp_center", "gripper::nowhere", "hand::palm"])
def test_an_unknown_frame_is_refused(plant, name):
    with pytest.raises(ValueError, match=f"safety.tool: must be a frame.* '{name}'"):
        Tool(plant, "arm", name)
