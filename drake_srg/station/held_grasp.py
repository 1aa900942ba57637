"""A hand's hold on an object: the contacts, and the object's mass and size."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydrake.geometry import GeometryId
from pydrake.systems.framework import Context, Diagram

from drake_srg.objects.solids import body_corners
from drake_srg.planning.grasps.grasp_measures import Body, Patch, contact_patches


class HeldGrasp(NamedTuple):
    """Inputs of grasp measures.

    Attributes:
        patches: The hand's contacts with the object.
        body: The object.
    """

    patches: list[Patch]
    body: Body


def read_grasp(station: Diagram, root: Context, name: str) -> HeldGrasp:
    """Return the hand's present contacts with an object.

    Args:
        station: A station with the ports of `MakeStation`'s.
        root: Context of the diagram that is simulated.
        name: Name of the object's model; its first body is the object.
    """
    plant = station.GetSubsystemByName("plant")
    context = plant.GetMyContextFromRoot(root)
    scene_graph = station.GetSubsystemByName("scene_graph")
    # The context's shapes and friction: an episode may have replaced the model's.
    query = scene_graph.get_query_output_port()
    inspector = query.Eval(scene_graph.GetMyContextFromRoot(root)).inspector()

    def geometries(model: str) -> set[GeometryId]:
        bodies = plant.GetBodyIndices(plant.GetModelInstanceByName(model))
        return {
            geometry
            for index in bodies
            for geometry in plant.GetCollisionGeometriesForBody(plant.get_body(index))
        }

    results = plant.get_contact_results_output_port().Eval(context)
    patches = contact_patches(
        results, inspector, thing=geometries(name), hand=geometries("gripper")
    )
    body = plant.get_body(plant.GetBodyIndices(plant.GetModelInstanceByName(name))[0])
    p_BC = body.CalcCenterOfMassInBodyFrame(context)
    corners = body_corners(plant, inspector, body)
    return HeldGrasp(
        patches,
        Body(
            mass=float(body.get_mass(context)),
            p_WB=body.EvalPoseInWorld(context) @ p_BC,
            size=float(np.linalg.norm(corners - p_BC, axis=1).max()),
        ),
    )
