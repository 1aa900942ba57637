"""The household objects among our models, for experiments, clutter and trying out."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.corners import hull_points
from drake_srg.objects.models import AddObject, object_body
from drake_srg.types import Vector

# Numbers are those of the YCB object set. The generators, tools/models/props.py,
# household.py, packages.py and tableware.py, say what is theirs and what is ours.
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
    """What an object is like.

    Attributes:
        low: Least coordinates of its collision geometry in its frame, shape (3,) [m].
        high: Greatest coordinates, shape (3,) [m].
        points: Points whose convex hull holds all of it, shape (n, 3) [m].
        mass: [kg].
        pieces: Number of its collision geometries.
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

    Args:
        name: For error messages.
        config: The object.

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
