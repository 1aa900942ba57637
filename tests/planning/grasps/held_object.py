"""Distances between the links of a gripper's model and an object in its hand."""

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.geometry import drake_shape
from drake_srg.parsing import AddModel


def link_distances(model, shape, grasp, fingers):
    """Return the signed distance from a held object to each link near it [m].

    Args:
        model: Name of the gripper's model.
        shape: The object's.
        grasp: The grasp that holds it.
        fingers: Joint angles of the gripper by name [rad].
    """
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 1e-3)
    gripper = AddModel(plant, f"package://drake_srg/sdf/{model}.sdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("palm"))
    body = plant.AddRigidBody(
        "object",
        plant.AddModelInstance("object"),
        SpatialInertia.SolidSphereWithMass(1.0, 0.1),
    )
    own = plant.RegisterCollisionGeometry(
        body, RigidTransform(), drake_shape(shape), "object", CoulombFriction(1, 1)
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
    for pair in query.ComputeSignedDistancePairwiseClosestPoints(0.3):
        if own in (pair.id_A, pair.id_B):
            other = pair.id_B if pair.id_A == own else pair.id_A
            name = inspector.GetName(inspector.GetFrameId(other)).split("::")[-1]
            distances[name] = min(distances.get(name, np.inf), pair.distance)
    return distances
