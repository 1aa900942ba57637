"""Cameras that look at an object in known poses, or at scenes drawn from a seed.

Nothing is simulated. Only images are judged.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, DiagramBuilder

from drake_srg.scenario import Scenario
from drake_srg.station import MakeStation
from drake_srg.station.perception import AddLocalizer
from drake_srg.types import Blob, Vector


class Eye:
    """The station and the localizer of a scenario, without the rest of its cell.

    Args:
        scenario: Names what to look for.

    Attributes:
        name: Of the picked object.
    """

    def __init__(self, scenario: Scenario):
        self.name = scenario.task.pick
        builder = DiagramBuilder()
        station = builder.AddNamedSystem("station", MakeStation(scenario))
        self._localizer = AddLocalizer(builder, scenario, station)
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._plant = station.GetSubsystemByName("plant")

    def blobs(self, X_WO: RigidTransform | None = None) -> list[Blob]:
        """Move the picked object, if anywhere, and return its blobs, the best first."""
        if X_WO is not None:
            moved = self._plant.GetMyMutableContextFromRoot(self._context)
            put_object(self._plant, moved, self.name, X_WO)
        context = self._localizer.GetMyContextFromRoot(self._context)
        blobs: Sequence[Blob] = self._localizer.GetOutputPort("blobs").Eval(context)
        return [blob for blob in blobs if blob.object_name == self.name]

    def pose(self) -> RigidTransform:
        """Return the pose X_WO of the picked object."""
        model = self._plant.GetModelInstanceByName(self.name)
        body = self._plant.get_body(self._plant.GetBodyIndices(model)[0])
        context = self._plant.GetMyContextFromRoot(self._context)
        return self._plant.EvalBodyPoseInWorld(context, body)


def put_object(
    plant: MultibodyPlant, context: Context, name: str, X_WO: RigidTransform
) -> None:
    """Move an object of one link in a plant's context."""
    (index,) = plant.GetBodyIndices(plant.GetModelInstanceByName(name))
    plant.SetFreeBodyPose(context, plant.get_body(index), X_WO)


def angle_between_axes(a: Vector, b: Vector) -> float:
    """Return the angle between two axes whose ends look alike [rad]."""
    turn = np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)
    return float(min(turn, np.pi - turn))
