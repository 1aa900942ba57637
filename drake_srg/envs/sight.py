"""Where the localizer's cameras see an episode's object: the observation `blobs`."""

from __future__ import annotations

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RollPitchYaw

from drake_srg.cell.perception import camera_models
from drake_srg.envs.episode_station import EpisodeStation
from drake_srg.envs.scenes import Scene
from drake_srg.scenario import Scenario
from drake_srg.types import Vector
from drake_srg.vision.blob_localizer import BlobLocalizer, BlobTarget
from drake_srg.vision.color import ColorRange

_PORTS = ("color_image", "depth_image", "body_pose_in_world")


class Sight:
    """Locates the object of each episode as a cell's localizer does.

    Args:
        scenario: With the localizer and its cameras.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._name = scenario.task.pick
        self._models = camera_models(scenario)
        self._config = scenario.localizer
        # An object keeps the colour of the first one; see docs/learning.md.
        self._color = ColorRange.around(scenario.objects[self._name].color)

    def find(self, station: EpisodeStation, scene: Scene) -> Vector | None:
        """Return the pose [x, y, z, yaw] (4) of the object, None if it is not seen.

        Args:
            station: With the cameras, and the object at its place.
            scene: The episode's object, whose shape the localizer knows.
        """
        localizer = BlobLocalizer(
            [BlobTarget(self._name, scene.shape, self._color)],
            self._models,
            min_area=self._config.min_area,
        )
        context = localizer.CreateDefaultContext()
        for camera in self._models:
            for port in _PORTS:
                value = AbstractValue.Make(station.measured(f"camera_{camera}.{port}"))
                localizer.GetInputPort(f"{camera}.{port}").FixValue(context, value)
        blobs = localizer.get_output_port().Eval(context)
        if not blobs:
            return None
        X_WO = max(blobs, key=lambda blob: (blob.certain, blob.trust)).X_WO
        yaw = 0.0 if scene.is_round else RollPitchYaw(X_WO.rotation()).yaw_angle()
        return np.append(X_WO.translation(), yaw)
