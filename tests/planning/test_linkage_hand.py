import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.geometry import Cylinder as DrakeCylinder
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from drake_srg.parsing import ConfigureParser
from drake_srg.planning.grasps import pose_along
from drake_srg.planning.linkage_hand import EMPTY_ANGLE, LinkageHand
from drake_srg.types import Box, Cylinder, Sphere

UP = np.array([0.0, 0.0, 1.0])
HAND = LinkageHand(p_GT=np.array([0.095, 0.0, 0.0]))
CYLINDER = Cylinder(0.0125, 0.05)


def tip_distances(model, shape, grasp, fingers):
    """Signed distance of a held object from each fingertip of a model [m]."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 1e-3)
    parser = Parser(plant)
    ConfigureParser(parser)
    (gripper,) = parser.AddModels(url=f"package://drake_srg/sdf/{model}.sdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("palm"))
    body = plant.AddRigidBody(
        "object",
        plant.AddModelInstance("object"),
        SpatialInertia.SolidSphereWithMass(1.0, 0.1),
    )
    own = plant.RegisterCollisionGeometry(
        body,
        RigidTransform(),
        DrakeCylinder(shape.radius, shape.length),
        "object",
        CoulombFriction(1, 1),
    )
    plant.Finalize()
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    context = plant.GetMyMutableContextFromRoot(root)
    plant.SetFreeBodyPose(context, body, grasp.X_GO)
    for name, angle in fingers.items():
        plant.GetJointByName(name, gripper).set_angle(context, angle)
    query = scene_graph.get_query_output_port().Eval(
        scene_graph.GetMyContextFromRoot(root)
    )
    inspector, distances = query.inspector(), {}
    for pair in query.ComputeSignedDistancePairwiseClosestPoints(0.1):
        if own in (pair.id_A, pair.id_B):
            other = pair.id_B if pair.id_A == own else pair.id_A
            name = inspector.GetName(inspector.GetFrameId(other)).split("::")[-1]
            distances[name] = min(distances.get(name, np.inf), pair.distance)
    return distances


@pytest.mark.parametrize("model", ["linkage_gripper", "linkage_gripper_flat"])
def test_the_pads_touch_the_cylinder_on_both_sides_and_nothing_else_does(model):
    (grasp,) = HAND.grasps(CYLINDER, UP)
    distances = tip_distances(model, CYLINDER, grasp, grasp.fingers_closed)
    tips = {name: d for name, d in distances.items() if "tip" in name}
    assert len(tips) == 2
    for name, distance in distances.items():
        if name in tips:
            # Boxes stand for the arc of a curved pad, within 0.2 mm.
            assert distance == pytest.approx(0.0, abs=3e-4)
        else:
            assert distance > 0.002


@pytest.mark.parametrize("model", ["linkage_gripper", "linkage_gripper_flat"])
@pytest.mark.parametrize("radius", [0.006, 0.0125, 0.02])
def test_the_open_hand_goes_around_the_object(model, radius):
    shape = Cylinder(radius, 0.05)
    (grasp,) = HAND.grasps(shape, UP)
    distances = tip_distances(model, shape, grasp, grasp.fingers_open)
    assert min(distances.values()) > 0.007


@given(radius=st.floats(0.005, 0.026))
def test_the_crank_angle_tells_an_object_from_nothing(radius):
    (grasp,) = HAND.grasps(Cylinder(radius, 0.05), UP)
    proximity = np.zeros(2)
    assert grasp.holds(np.full(2, grasp.contact_angle), proximity)
    assert not grasp.holds(np.full(2, EMPTY_ANGLE), proximity)
    assert 0.0 <= grasp.closure_open < grasp.closure_closed == 1.0


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.1, 1))
def test_a_reached_target_holds_the_object_along_its_axis(x, y, z):
    (grasp,) = HAND.grasps(CYLINDER, UP)
    axis = np.array([x, y, z]) / np.linalg.norm([x, y, z])

    X_WO = pose_along([0.3, 0.1, 0.125], axis)
    X_WG = X_WO @ grasp.X_GO.inverse()
    target = grasp.target(X_WO)
    assert target.distance(X_WG) == pytest.approx(0.0, abs=1e-12)
    assert target.angle_violation(X_WG) == 0.0


@pytest.mark.parametrize(
    "shape",
    [Cylinder(0.001, 0.05), Cylinder(0.04, 0.05), Sphere(0.0125), Box([0.02] * 3)],
)
def test_what_does_not_fit_the_hand_has_no_grasp(shape):
    assert HAND.grasps(shape, UP) == []
