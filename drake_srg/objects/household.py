"""Our models of household objects, and pictures of objects."""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Mapping, Sequence

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    LightParameter,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import Context, DiagramBuilder
from pydrake.systems.sensors import CameraInfo

from drake_srg.common.geometry import look_at
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import AddObject, object_body
from drake_srg.objects.solids import hull_points
from drake_srg.types import Vector

# The numbers in names are those of the YCB object set. The generators
# (tools/models/props.py, household.py, packages.py and tableware.py) mark which
# dimensions come from that set and which are ours.
HOUSEHOLD = (
    "003_cracker_box",
    "004_sugar_box",
    "005_tomato_soup_can",
    "007_tuna_can",
    "008_pudding_box",
    "010_potted_meat_can",
    "011_banana",
    "019_pitcher_base",
    "029_plate",
    "031_spoon",
    "036_wood_block",
    "040_large_marker",
    "043_phillips_screwdriver",
    "048_hammer",
    "056_tennis_ball",
    "061_foam_brick",
    "bowl",
    "mug",
    "squeeze_bottle",
    "wrench",
)


def household_object(name: str) -> ObjectConfig:
    """Return a new config of one of `HOUSEHOLD`."""
    return ObjectConfig(model=f"package://drake_srg/sdf/{name}.sdf")


@dc.dataclass(frozen=True, eq=False)
class ObjectFacts:
    """Facts about an object.

    Attributes:
        low: Least coordinates of its collision geometry in its frame, shape (3,) [m].
        high: Greatest coordinates, shape (3,) [m].
        points: Points whose convex hull encloses the geometry, shape (n, 3) [m].
        mass: [kg].
        pieces: Number of collision geometries.
    """

    low: Vector
    high: Vector
    points: Vector
    mass: float
    pieces: int

    @property
    def size(self) -> Vector:
        """Extents along x, y, z [m], shape (3,)."""
        return self.high - self.low


def object_facts(name: str, config: ObjectConfig) -> ObjectFacts:
    """Measure an object that is not soft.

    Raises:
        ScenarioError: If the model cannot be read.
    """
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    body = plant.get_body(object_body(plant, AddObject(plant, name, config)))
    plant.Finalize()
    inspector = scene_graph.model_inspector()
    pieces = hull_points(plant, inspector, body)
    points = np.vstack(pieces)
    mass = body.default_mass()
    low, high = points.min(axis=0), points.max(axis=0)
    return ObjectFacts(low, high, points, mass, len(pieces))


Image = npt.NDArray[np.uint8]

_DIRECTION = np.array([0.55, -0.70, 0.46])  # from the object to the camera
FIELD_OF_VIEW = 0.5  # rad
_LIGHTS = (([-0.4, 0.8, -1.0], 0.9), ([-0.8, 0.1, -0.2], 0.5), ([0.6, 0.6, -0.1], 0.3))


def take_portrait(name: str, config: ObjectConfig, size: int = 320) -> Image:
    """Return an image of an object on white, RGB, shape (size, size, 3).

    Args:
        name: The object's name, for error messages.
        config: The object, not soft; it is placed at the world's origin.
        size: Width and height [pixels].

    Raises:
        ScenarioError: If the model cannot be read.
    """
    facts = object_facts(name, config)
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    AddStudio(scene_graph, _LIGHTS)
    AddObject(plant, name, config)
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    middle, radius = 0.5 * (facts.low + facts.high), 0.5 * np.linalg.norm(facts.size)
    distance = 1.05 * radius / math.sin(0.5 * FIELD_OF_VIEW)
    eye = middle + distance * _DIRECTION / np.linalg.norm(_DIRECTION)
    X_WC, clipping = look_at(eye, middle), ClippingRange(0.1 * distance, 10 * distance)
    return photograph(scene_graph, context, X_WC, clipping, size)


def AddStudio(
    scene_graph: SceneGraph, lights: Sequence[tuple[Sequence[float], float]]
) -> None:
    """Add a renderer with a white background for `photograph`.

    Args:
        scene_graph: The scene.
        lights: Direction and intensity of each directional light.
    """
    made = [
        LightParameter(
            type="directional", frame="world", direction=direction, intensity=intensity
        )
        for direction, intensity in lights
    ]
    params = RenderEngineVtkParams(default_clear_color=[1.0, 1.0, 1.0], lights=made)
    scene_graph.AddRenderer("studio", MakeRenderEngineVtk(params))


def photograph(
    scene_graph: SceneGraph,
    context: Context,
    X_WC: RigidTransform,
    clipping: ClippingRange,
    size: int,
) -> Image:
    """Return an image from the renderer of `AddStudio`, RGB, shape (size, size, 3).

    Args:
        scene_graph: The scene.
        context: The root diagram's.
        X_WC: Pose of the camera, whose field of view is `FIELD_OF_VIEW`.
        clipping: Nearest and farthest visible distance.
        size: Width and height [pixels].
    """
    info = CameraInfo(size, size, FIELD_OF_VIEW)
    core = RenderCameraCore("studio", info, clipping, RigidTransform())
    query = scene_graph.get_query_output_port().Eval(
        scene_graph.GetMyContextFromRoot(context)
    )
    image = query.RenderColorImage(
        ColorRenderCamera(core), scene_graph.world_frame_id(), X_WC
    )
    return np.array(image.data[:, :, :3])


def contact_sheet(pictures: Mapping[str, Image]) -> Image:
    """Return a sheet of RGB pictures of equal size, named, in rows of five."""
    tiles, across = [], 5
    for name, picture in pictures.items():
        strip = np.full((24, picture.shape[1], 3), 255, np.uint8)
        font = cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(strip, name, (6, 15), font, 0.42, (60, 60, 60), 1, cv2.LINE_AA)
        tiles.append(np.vstack([picture, strip]))
    blank = np.full_like(tiles[0], 255)
    tiles += [blank] * (-len(tiles) % across)
    rows = [np.hstack(tiles[i : i + across]) for i in range(0, len(tiles), across)]
    sheet: Image = np.vstack(rows)
    return sheet
