"""Cards that hang in front of a camera and hide parts of objects."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import Box as DrakeBox
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.models import simple_shape
from drake_srg.scenario import Scenario
from drake_srg.types import Vector

# Distance from the camera to the card, over that to the object: so near the camera that
# an arm on the table does not reach it.
_SHARE_OF_DISTANCE = 0.3
_GREY = [0.35, 0.35, 0.35, 1.0]


def AddCard(plant: MultibodyPlant, scenario: Scenario, name: str, p_WO: Vector) -> None:
    """Hang up a card that hides part of an object, before the plant is finalized.

    The card can be seen, not touched.

    Args:
        plant: A plant registered with a scene graph.
        scenario: The card hides the object from its localizer's first camera.
        name: An object with an `occlusion`.
        p_WO: Position of the object in world [m], shape (3,).

    Raises:
        ScenarioError: If the localizer's first camera is not fixed in world, or the
            object is not of one simple shape.
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
    radius = _SHARE_OF_DISTANCE * _half_width(scenario, name)  # projected onto the card
    side = 2.4 * radius  # wide enough to hide all of it
    aside = radius * (1.0 - 2.0 * config.share) + 0.5 * side
    X_WCard = RigidTransform(R_WCard, p_WC + sight + aside * R_WCard.matrix()[:, 0])
    plant.RegisterVisualGeometry(
        plant.world_body(), X_WCard, DrakeBox(side, side, 1e-3), f"card_{name}", _GREY
    )


def _facing(sight: Vector, direction: float) -> RotationMatrix:
    """Return the axes of a card: z along a line of sight, x closest to a direction."""
    z = sight / np.linalg.norm(sight)
    x = np.array([np.cos(direction), np.sin(direction), 0.0])
    x = x - (x @ z) * z
    x = x / np.linalg.norm(x)
    return RotationMatrix(np.column_stack([x, np.cross(z, x), z]))


def _half_width(scenario: Scenario, name: str) -> float:
    """Return half the width of an upright object [m]."""
    shape = simple_shape(name, scenario.objects[name])
    if shape is None:
        raise ScenarioError(
            f"objects.{name}.occlusion: needs an object of one simple shape"
        )
    return shape.upright_radius
