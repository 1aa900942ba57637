"""Cameras that look at an object in known poses, or at scenes drawn from a seed.

Nothing is simulated. Only images are judged.
"""

from __future__ import annotations

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from drake_srg import MakeStation, Scenario
from drake_srg.station.perception import AddLocalizer
from drake_srg.theses.blob_localizer import ThesisBlobLocalizer
from drake_srg.types import Blob, Vector


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
        model = self._plant.GetModelInstanceByName(self._name)
        (index,) = self._plant.GetBodyIndices(model)
        self._body = self._plant.get_body(index)

    def blobs(self, X_WO: RigidTransform | None = None) -> list[Blob]:
        """Move the picked object, if anywhere, and return its blobs, the best first."""
        if X_WO is not None:
            moved = self._plant.GetMyMutableContextFromRoot(self._context)
            self._plant.SetFreeBodyPose(moved, self._body, X_WO)
        context = self._localizer.GetMyContextFromRoot(self._context)
        if isinstance(self._localizer, ThesisBlobLocalizer):
            blob = self._localizer.locate(context)
            return [] if blob is None else [blob]
        blobs: list[Blob] = self._localizer.GetOutputPort("blobs").Eval(context)
        return [blob for blob in blobs if blob.object_name == self._name]

    def offset(self, X_WO: RigidTransform) -> Vector:
        """Return the error of locating an object at X_WO, shape (3,) [m].

        It is NaN unless one thing is seen: a second one would be something else.
        """
        blobs = self.blobs(X_WO)
        seen = blobs[0].position if len(blobs) == 1 else np.full(3, np.nan)
        offset: Vector = seen - X_WO.translation()
        return offset

    def pose(self) -> RigidTransform:
        """Return the pose X_WO of the picked object."""
        context = self._plant.GetMyContextFromRoot(self._context)
        return self._plant.EvalBodyPoseInWorld(context, self._body)


def angle_between_axes(a: Vector, b: Vector) -> float:
    """Return the angle between two axes, whatever their signs [rad]."""
    turn = np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)
    return float(min(turn, np.pi - turn))
