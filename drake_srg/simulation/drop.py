"""Drops an object on a table and tells whether it comes to rest."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.common.schema import Transform
from pydrake.math import RigidTransform

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import object_facts
from drake_srg.scenario import Scenario
from drake_srg.simulation.rig import Rig
from drake_srg.simulation.tabletop import tabletop

HEIGHT = 0.005  # of the underside above the table [m]
_PLACE = (0.5, 0.0)  # on the table, in world [m]
QUIET = 0.005  # a slower object rests [m/s]
# When it must rest, at best and at the latest, and how long it is watched [s].
SOON, LATE, _WATCHED = 1.2, 3.0, 0.2
_PERIOD = 0.01  # between looks at the speed [s]


@dc.dataclass(frozen=True)
class DropOutcome:
    """What a dropped object does.

    Attributes:
        rests: Whether it is quiet, and still on the table.
        after: Time from its release [s].
        speed: Largest speed of any of its points in the last 0.2 s [m/s].
        moved: Distance of its origin from where it was released, sideways [m].
    """

    rests: bool
    after: float
    speed: float
    moved: float

    def __str__(self) -> str:
        """The outcome in words."""
        verb = "rests" if self.rests else "does not rest"
        return (
            f"{verb}: {1e3 * self.speed:.1f} mm/s {self.after:g} s after a drop from "
            f"{1e3 * HEIGHT:g} mm, {1e3 * self.moved:.1f} mm to the side"
        )


def above_table(thing: ObjectConfig) -> Scenario:
    """Return a scenario in which an object is let go just above a table.

    The table brings objects to rest (see `tabletop`).

    Args:
        thing: The object, named `thing`, as it stands.

    Raises:
        ScenarioError: If the object's model cannot be read.
    """
    low = object_facts("thing", thing).low
    X_WO = RigidTransform([*_PLACE, HEIGHT - low[2]])
    return tabletop({"thing": dc.replace(thing, pose=Transform(X_WO), position=None)})


def drop(thing: ObjectConfig) -> DropOutcome:
    """Drop an object and watch it until it rests, for 3 s at most.

    Args:
        thing: The object; it falls as it stands.

    Raises:
        ScenarioError: If its model cannot be read.
    """
    prepared = above_table(thing)
    size = np.linalg.norm(object_facts("thing", thing).size)
    with Rig(prepared, name="drop", period=_PERIOD, log_period=_PERIOD) as rig:
        model = rig.plant.GetModelInstanceByName("thing")
        (index,) = rig.plant.GetBodyIndices(model)
        body = rig.plant.get_body(index)
        start = rig.X_WO("thing").translation()
        speeds: list[float] = []
        try:
            while True:
                rig.advance(_PERIOD)
                V = rig.plant.EvalBodySpatialVelocityInWorld(rig.plant_context, body)
                turning = 0.5 * size * np.linalg.norm(V.rotational())
                speeds.append(float(max(np.linalg.norm(V.translational()), turning)))
                recent = speeds[-round(_WATCHED / _PERIOD) :]
                quiet = max(recent) < QUIET
                if rig.time > LATE - 1e-6 or (rig.time > SOON - 1e-6 and quiet):
                    break
        except ScenarioError:  # Drake gave up on what became of the contact
            return DropOutcome(False, rig.time, np.inf, np.inf)
        away = rig.X_WO("thing").translation() - start
    moved = float(np.linalg.norm(away[:2]))
    on_table = abs(away[2]) < size
    return DropOutcome(bool(quiet and on_table), round(rig.time, 2), max(recent), moved)
