"""Where falling objects start: one above the other where they would overlap."""

from __future__ import annotations

import itertools

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import object_facts
from drake_srg.types import Vector


class Drops:
    """Heights at which objects with `drop` start, in the order of the objects.

    Args:
        table_height: In world [m].
    """

    def __init__(self, table_height: float) -> None:
        self._table = table_height
        self._boxes: list[tuple[Vector, Vector]] = []

    def X_WO_start(
        self, name: str, config: ObjectConfig, X_WO: RigidTransform
    ) -> RigidTransform:
        """Return where an object starts.

        The box around it clears the table and those of falling objects before it. It
        may overlap objects that stand on the table.

        Args:
            name: The object's name, for error messages.
            config: The object, with `drop`.
            X_WO: Its pose, of which the height does not count [m].

        Raises:
            ScenarioError: If its model cannot be read.
        """
        assert config.drop is not None
        facts = object_facts(name, config)
        ends = np.array([facts.low, facts.high])
        choices = itertools.product((0, 1), repeat=3)
        corners = np.array([ends[choice, range(3)] for choice in choices])
        p_W = corners @ X_WO.rotation().matrix().T + X_WO.translation()
        low, high = p_W.min(axis=0), p_W.max(axis=0)
        floor = self._table
        # From the lowest box up: an object may fit under one that starts high.
        for below, above in sorted(self._boxes, key=lambda box: box[0][2]):
            beside = np.any((below[:2] > high[:2]) | (above[:2] < low[:2]))
            room = below[2] - floor
            if not beside and room < config.drop + high[2] - low[2]:
                floor = max(floor, above[2])
        rise = np.array([0.0, 0.0, floor + config.drop - low[2]])
        self._boxes.append((low + rise, high + rise))
        return RigidTransform(X_WO.rotation(), X_WO.translation() + rise)
