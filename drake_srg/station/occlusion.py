"""Cards that hang before a camera and hide parts of objects."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import Box as DrakeBox
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.models import simple_shape
from drake_srg.scenario import Scenario
from drake_srg.types import Vector

# From the camera to the card, over the distance to the object: so near that an arm on
# the table does not reach it.
_SHARE_OF_DISTANCE = 0.3
_GREY = [0.35, 0.35, 0.35, 1.0]


def AddCard(plant: MultibodyPlant, scenario: Scenario, name: str, p_WO: Vector) -> None:
    """Hang up what hides a part of an object, before the plant is finalized.

    It can be seen, not touched.

    Args:
        plant: Registered with a scene graph.
        scenario: Its localizer's first camera is the one that sees less.
        name: Of the object, which has an `occlusion`.
        p_WO: Where that stands [m], shape (3,).

    Raises:
        ScenarioError: If no localizer's camera is fixed in the world.
    """
    config = scenario.objects[name].occlusion
    key = f"objects.{name}.occlusion"
    if not scenario.localizer.cameras:
        raise ScenarioError(f"{key}: needs at least one camera in localizer.cameras")
    camera = scenario.cameras[scenario.localizer.cameras[0]]
    if camera.X_PB.base_frame not in (None, "world"):
        raise ScenarioError(
            f"{key}: needs a first localizer camera that is fixed in world, got one in "
            f"{camera.X_PB.base_frame}"
        )
    if config is None or config.share == 0.0:
        return
    p_WC = camera.X_PB.GetDeterministicValue().translation()
    sight = _SHARE_OF_DISTANCE * (p_WO - p_WC)
    R_WCard = _facing(sight, config.direction)
    radius = _SHARE_OF_DISTANCE * _half_width(scenario, name)  # as the card has it
    side = 2.4 * radius  # no more than that is hidden
    aside = radius * (1.0 - 2.0 * config.share) + 0.5 * side
    X_WCard = RigidTransform(R_WCard, p_WC + sight + aside * R_WCard.matrix()[:, 0])
    plant.RegisterVisualGeometry(
        plant.world_body(), X_WCard, DrakeBox(side, side, 1e-3), f"card_{name}", _GREY
    )


def _facing(sight: Vector, direction: float) -> RotationMatrix:
    """Axes of a card: z along a line of sight, x as near as can be to a direction."""
    z = sight / np.linalg.norm(sight)
    x = np.array([np.cos(direction), np.sin(direction), 0.0])
    x = x - (x @ z) * z
    x = x / np.linalg.norm(x)
    return RotationMatrix(np.column_stack([x, np.cross(z, x), z]))


def _half_width(scenario: Scenario, name: str) -> float:
    """Half the width of an object that stands [m]."""
    shape = simple_shape(name, scenario.objects[name])
    if shape is None:
        raise ScenarioError(
            f"objects.{name}.occlusion: needs an object of one simple shape"
        )
    return shape.upright_radius
