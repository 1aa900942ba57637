"""Puts a twin's objects where cameras see them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context

from drake_srg.objects.models import object_body
from drake_srg.twin.sightings import Sighting
from drake_srg.types import Vector

# An object that is nearer to the hand's grasp centre is left to contact [m]: half a
# finger and half a can.
_HAND = 0.15
# Two pictures in a row show an object at rest if it is this near [m].
_RESTS = 0.01


class Placing:
    """Puts objects of a plant where they are seen: at first, and where twins part.

    It never touches an object near the hand: whether that is held is for the simulated
    contact to tell. Call it between two steps of the simulation.

    Args:
        plant: The twin's.
        context: Its context, changed.
        names: Of the objects.

    Attributes:
        placed_at: When each object was put somewhere last [s], by name.
    """

    def __init__(
        self, plant: MultibodyPlant, context: Context, names: Sequence[str]
    ) -> None:
        self._plant, self._context = plant, context
        bodies = {
            name: object_body(plant, plant.GetModelInstanceByName(name))
            for name in names
        }
        self._bodies = {n: b for n, b in bodies.items() if isinstance(b, BodyIndex)}
        gripper = plant.GetModelInstanceByName("gripper")
        self._hand = plant.GetFrameByName("grasp_center", gripper)
        self._last: dict[str, Vector] = {}
        self.placed_at: dict[str, float] = {}

    def place(
        self, sightings: Sequence[Sighting], parted: Mapping[str, bool], time: float
    ) -> list[str]:
        """Put objects where they are seen; return the names of those that moved.

        Args:
            sightings: The new ones.
            parted: Whether each object is known to be elsewhere than in the twin.
            time: Now [s].
        """
        p_WH = self._hand.CalcPoseInWorld(self._context).translation()
        moved = []
        for seen in sightings:
            body = self._bodies.get(seen.name)
            if body is None or not seen.clear:
                continue
            p_WO = seen.X_WO.translation()
            last = self._last.get(seen.name, np.full(3, np.inf))
            self._last[seen.name] = p_WO
            first = seen.name not in self.placed_at
            rests = bool(np.linalg.norm(p_WO - last) < _RESTS)
            far = bool(np.linalg.norm(p_WO - p_WH) > _HAND)
            if far and rests and (first or parted.get(seen.name, False)):
                self._put(body, seen)
                self.placed_at[seen.name] = time
                moved.append(seen.name)
        return moved

    def _put(self, index: BodyIndex, seen: Sighting) -> None:
        body = self._plant.get_body(index)
        self._plant.SetFreeBodyPose(self._context, body, seen.X_WO)
        self._plant.SetVelocities(self._context, body.model_instance(), np.zeros(6))
