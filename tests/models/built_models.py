"""Plants of single models, and measurements on them."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.geometry import (
    GeometryInstance,
    ProximityProperties,
    ReadObjToTriangleSurfaceMesh,
    Role,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from drake_srg.objects.household import HOUSEHOLD
from drake_srg.parsing import configure_parser

HOLES = (
    *("hole_none", "pin_20", "hole_25", "hole_12", "hole_square", "hole_keyed"),
    *("hole_25_chamfer", "hole_12_chamfer", "hole_25_mesh"),
    *("hole_square_chamfer", "hole_keyed_chamfer"),
)
BASES = {
    "srg": "palm",
    "srg_fast": "palm",
    "iiwa14": "link_0",
    "gantry": "stand",
    "gantry_turning": "stand",
    "assistive_arm": "base",
    "linkage_gripper": "palm",
    "linkage_gripper_flat": "palm",
    "linkage_gripper_fast": "palm",
    "linkage_gripper_bare": "palm",
    "small_table": "table",
    "small_table_recess": "table",
    "bench": "bench",
    **dict.fromkeys(HOLES, "block"),
}


CAN = "005_tomato_soup_can"
NOT_CONVEX = (
    *("mug", "bowl", "squeeze_bottle", "wrench", "011_banana", "019_pitcher_base"),
    *("029_plate", "031_spoon", "043_phillips_screwdriver", "048_hammer"),
)
PACKAGES = tuple(name for name in HOUSEHOLD if name not in (*NOT_CONVEX, CAN))
SEED = 20240607


class Built:
    """A plant with one model, welded to the world at its base if it has one."""

    def __init__(self, name: str) -> None:
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(builder, 0.002)
        parser = Parser(self.plant)
        configure_parser(parser)
        url = f"package://drake_srg/sdf/{name}.sdf"
        (self.model,) = parser.AddModelsFromUrl(url)
        if name in BASES:
            base = self.plant.GetFrameByName(BASES[name])
            self.plant.WeldFrames(self.plant.world_frame(), base)
        self.plant.Finalize()
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()
        self.plant_context = self.plant.GetMyMutableContextFromRoot(self.context)
        self.inspector = self.scene_graph.model_inspector()

    def bodies(self) -> list[Any]:
        indices = self.plant.GetBodyIndices(self.model)
        return [self.plant.get_body(index) for index in indices]

    def shapes(self, body: Any, role: Role) -> list[tuple[str, Any, RigidTransform]]:
        frame = self.plant.GetBodyFrameIdOrThrow(body.index())
        return [
            (
                self.inspector.GetName(g),
                self.inspector.GetShape(g),
                self.inspector.GetPoseInFrame(g),
            )
            for g in self.inspector.GetGeometries(frame, role)
        ]

    def set_joints(self, **angles: float) -> None:
        for name, angle in angles.items():
            self.plant.GetJointByName(name).set_angle(self.plant_context, angle)

    def touching(self) -> set[tuple[str, str]]:
        """Return the pairs of bodies that penetrate each other by more than 10 µm."""
        context = self.scene_graph.GetMyContextFromRoot(self.context)
        query = self.scene_graph.get_query_output_port().Eval(context)
        pairs = set()
        for pair in query.ComputePointPairPenetration():
            if pair.depth > 1e-5:
                frames = [self.inspector.GetFrameId(g) for g in (pair.id_A, pair.id_B)]
                names = [self.plant.GetBodyFromFrameId(f).name() for f in frames]
                pairs.add((min(names), max(names)))
        return pairs


def moduli(built: Built) -> dict[tuple[str, str], float]:
    """Return the hydroelastic modulus [Pa] of each geometry by its body and name.

    Rigid geometry has an infinite one.
    """
    found = {}
    for body in built.bodies():
        frame = built.plant.GetBodyFrameIdOrThrow(body.index())
        for g in built.inspector.GetGeometries(frame, Role.kProximity):
            key = body.name(), built.inspector.GetName(g)
            properties = built.inspector.GetProximityProperties(g)
            found[key] = properties.GetPropertyOrDefault(
                "hydroelastic", "hydroelastic_modulus", np.inf
            )
    return found


@functools.cache
def build(name: str) -> Built:
    return Built(name)


def extent(built: Built, body: Any) -> tuple[np.ndarray, np.ndarray]:
    shapes = built.shapes(body, Role.kIllustration)
    points = np.vstack([(X @ mesh_points(shape).T).T for _, shape, X in shapes])
    return points.min(axis=0), points.max(axis=0)


def mesh_points(shape: Any) -> np.ndarray:
    return np.array(ReadObjToTriangleSurfaceMesh(str(path_of(shape))).vertices())


def path_of(shape: Any) -> Path:
    return Path(shape.source().path())


class Distances:
    """Signed distances to anchored shapes."""

    def __init__(self, shapes: list[tuple[str, Any, RigidTransform]]) -> None:
        self._scene_graph = SceneGraph()
        source = self._scene_graph.RegisterSource("shapes")
        for name, shape, X in shapes:
            instance = GeometryInstance(X, shape, name)
            instance.set_proximity_properties(ProximityProperties())
            self._scene_graph.RegisterAnchoredGeometry(source, instance)
        self._context = self._scene_graph.CreateDefaultContext()
        self._query = self._scene_graph.get_query_output_port().Eval(self._context)

    def at(self, p: np.ndarray) -> dict[str, float]:
        inspector = self._query.inspector()
        return {
            inspector.GetName(d.id_G): d.distance
            for d in self._query.ComputeSignedDistanceToPoint(p)
        }
