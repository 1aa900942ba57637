import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.geometry import Cylinder as DrakeCylinder
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from drake_srg.parsing import configure_parser
from drake_srg.planning.grasps.grasps import pose_along
from drake_srg.planning.grasps.linkage_hand import EMPTY_ANGLE, LinkageHand
from drake_srg.types import Box, Cylinder, Sphere

UP = np.array([0.0, 0.0, 1.0])
HAND = LinkageHand(p_GT=np.array([0.095, 0.0, 0.0]))
CYLINDER = Cylinder(0.0125, 0.05)


def tip_distances(model, shape, grasp, fingers):
    """Signed distance of a held object from each fingertip of a model [m]."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 1e-3)
    parser = Parser(plant)
    configure_parser(parser)
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


@given(st.floats(-np.pi, np.pi), st.floats(-0.25, 0.25))
def test_what_lies_is_taken_from_above_though_it_is_across_the_pads(azimuth, across):
    axis = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    (grasp,) = HAND.grasps(CYLINDER, axis)
    assert grasp.closure_open == 0.0
    # The palm above it, looking down, its z turned from the axis.
    z = np.array([np.cos(azimuth + across), np.sin(azimuth + across), 0.0])
    R_WG = RotationMatrix(np.column_stack([-UP, np.cross(z, -UP), z]))
    X_WO = pose_along([0.3, 0.1, 0.1125], axis)
    X_WG = RigidTransform(R_WG, X_WO.translation() - R_WG @ grasp.p_GO)
    target = grasp.pick_target(X_WO)
    assert target.distance(X_WG) == pytest.approx(0.0, abs=1e-12)
    assert target.angle_violation(X_WG) == 0.0
    leaning = X_WG @ RigidTransform(RotationMatrix.MakeYRotation(0.01), np.zeros(3))
    assert target.angle_violation(leaning) > 0.0
    # It is set down as it is held: along the pads.
    if abs(across) > 0.002:
        assert grasp.target(X_WO).angle_violation(X_WG) > 0.0


def test_what_is_across_fits_between_the_open_pads():
    axis = np.array([1.0, 0.0, 0.0])
    for radius in (0.006, 0.0125, 0.018, 0.026):
        (grasp,) = HAND.grasps(Cylinder(radius, 0.05), axis)
        # At the ends of pads of 24 mm, half of the gap of 60 mm.
        half = radius / np.cos(grasp.across) + 0.012 * np.tan(grasp.across)
        assert half < 0.03


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
