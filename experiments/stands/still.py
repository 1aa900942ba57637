"""A picture of a state that an experiment has reached."""

from __future__ import annotations

import copy
import dataclasses as dc

import numpy as np
import numpy.typing as npt
from pydrake.common.schema import Transform

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.geometry import look_at
from drake_srg.scenario import LocalizerConfig, Scenario
from drake_srg.station import MakeStation
from drake_srg.types import Vector

# Position of the camera relative to the point it looks at: in front, to the right of
# the hand and above, at a distance that shows 0.3 m [m].
_EYE = np.array([0.30, -0.28, 0.17])


def take_picture(
    scenario: Scenario, q: Vector, p_WL: Vector, size: int
) -> npt.NDArray[np.uint8]:
    """Return an image of gripper and objects on white, shape (size, size, 3).

    The image comes from the scenario's `recording.video_camera`, moved closer to p_WL
    (3,) [m], and shows the station's plant at `q`.

    Raises:
        ScenarioError: If the scenario has no such camera.
    """
    name = scenario.recording.video_camera
    if name not in scenario.cameras:
        raise ScenarioError("recording.video_camera: must name a camera")
    camera = copy.deepcopy(scenario.cameras[name])
    camera.width = camera.height = size
    X_WC = look_at(p_WL + _EYE, p_WL)
    camera.X_PB = Transform(X_WC)
    camera.X_PB.base_frame = "world"
    station = MakeStation(
        dc.replace(scenario, cameras={name: camera}, localizer=LocalizerConfig())
    )
    context = station.CreateDefaultContext()
    plant = station.GetSubsystemByName("plant")
    plant.SetPositions(plant.GetMyMutableContextFromRoot(context), q)
    sensor = station.GetSubsystemByName(f"rgbd_sensor_{name}")
    sensor_context = sensor.GetMyContextFromRoot(context)
    color = sensor.color_image_output_port().Eval(sensor_context).data[:, :, :3].copy()
    # The label of a pixel is the index of the body that it shows.
    label = sensor.label_image_output_port().Eval(sensor_context).data[:, :, 0]
    models = map(plant.GetModelInstanceByName, ("gripper", *scenario.objects))
    shown = [int(body) for model in models for body in plant.GetBodyIndices(model)]
    color[~np.isin(label, shown)] = 255
    return color
