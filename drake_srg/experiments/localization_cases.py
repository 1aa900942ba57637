"""The five-axis cell's cylinder in known poses, and how its camera locates it."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterator

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import DiagramBuilder

from drake_srg.experiments.varied_scenes import angle_between_axes, put_object
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.station import MakeStation
from drake_srg.station.perception import AddLocalizer
from drake_srg.types import Blob, BlobFlag, Cylinder, Vector

SCENARIO, CAMERA = "assistive_arm", "ceiling"
STANDING, RECESS, TILTED, LYING = "standing", "in the recess", "tilted", "lying"
_SIDES = ("width", "height")
_RECESS_DEPTH = 0.005  # m
_PLAY = 0.7e-3  # in the recess, on both axes; less than its clearance [m]


@dc.dataclass(frozen=True)
class Case:
    """One way in which the cylinder is placed, seen with images of one size."""

    way: str
    size: tuple[int, int]

    def __str__(self) -> str:
        return f"{self.way}, {self.size[0]} x {self.size[1]}"


@dc.dataclass(frozen=True)
class Sighting:
    """How a cylinder was located. Numbers are NaN if it was not seen.

    Attributes:
        X_WO: Its true pose.
        error: Estimated minus true centre, in W [m], shape (3,).
        turn: Angle between the estimated and the true axis [rad].
        quality: Quality of the blob.
        uncertain: Whether the blob is uncertain or missing.
    """

    X_WO: RigidTransform
    error: Vector
    turn: float
    quality: float
    uncertain: bool

    @property
    def distance(self) -> float:
        """Distance from the estimated to the true centre [m]."""
        return float(np.linalg.norm(self.error))

    @property
    def tilt(self) -> float:
        """Angle of the axis from the vertical [rad]."""
        return float(np.arccos(min(1.0, self.X_WO.rotation().matrix()[2, 2])))


def load(size: tuple[int, int]) -> Scenario:
    """Return the scenario with camera images of a size [pixels]."""
    changes = [f"cameras.{CAMERA}.{k}={v}" for k, v in zip(_SIDES, size, strict=True)]
    return load_scenario(SCENARIO, seed=0, overrides=changes)


def poses(
    scenario: Scenario, way: str, grid: int, others: int
) -> Iterator[RigidTransform]:
    """Yield poses X_WO of the cylinder all over the pick region, or in the recess.

    Args:
        scenario: See `load`.
        way: STANDING, RECESS, TILTED or LYING.
        grid: Standing places along each side of the region, and places in the recess.
        others: Number of tilted or lying places.
    """
    rng = np.random.default_rng(0)
    shape = scenario.objects[scenario.task.pick].shape
    assert isinstance(shape, Cylinder)
    region = scenario.task.region
    assert region is not None
    if way == STANDING:
        sides = np.linspace(region.min, region.max, grid).T
        places = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
        tilts = np.zeros(len(places))
    elif way == RECESS:
        places = rng.uniform(-_PLAY, _PLAY, (grid, 2)) + scenario.task.place.position
        tilts = np.zeros(len(places))
    else:
        places = rng.uniform(region.min, region.max, (others, 2))
        least = 0.0 if way == TILTED else np.pi / 2
        tilts = rng.uniform(least, np.pi / 2, others)
    for place, tilt in zip(places, tilts, strict=True):
        azimuth = rng.uniform(-np.pi, np.pi)
        level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        axis = np.sin(tilt) * level + [0.0, 0.0, np.cos(tilt)]
        height = 0.5 * shape.length * np.cos(tilt) + shape.radius * np.sin(tilt)
        height += scenario.table.height - (_RECESS_DEPTH if way == RECESS else 0.0)
        R_WO = RotationMatrix.MakeFromOneVector(axis, 2)
        yield RigidTransform(R_WO, [*place, height])


class Eye:
    """The station and the localizer of a scenario, without the rest of its cell."""

    def __init__(self, scenario: Scenario):
        self._name = scenario.task.pick
        builder = DiagramBuilder()
        station = builder.AddNamedSystem("station", MakeStation(scenario))
        self._localizer = AddLocalizer(builder, scenario, station)
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._plant = station.GetSubsystemByName("plant")

    def blobs(self, X_WO: RigidTransform) -> list[Blob]:
        """Move the picked object and return its blobs, the best first."""
        moved = self._plant.GetMyMutableContextFromRoot(self._context)
        put_object(self._plant, moved, self._name, X_WO)
        context = self._localizer.GetMyContextFromRoot(self._context)
        blobs: list[Blob] = self._localizer.GetOutputPort("blobs").Eval(context)
        return [blob for blob in blobs if blob.object_name == self._name]

    def look(self, X_WO: RigidTransform) -> Sighting:
        """Move the picked object and locate it."""
        blobs = self.blobs(X_WO)
        if len(blobs) != 1:  # a second blob would show something else
            return Sighting(X_WO, np.full(3, np.nan), np.nan, np.nan, True)
        blob = blobs[0]
        return Sighting(
            X_WO,
            blob.position - X_WO.translation(),
            angle_between_axes(blob.axis, X_WO.rotation().matrix()[:, 2]),
            blob.quality,
            BlobFlag.UNCERTAIN in blob.flags,
        )
