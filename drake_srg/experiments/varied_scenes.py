"""Where the localizer sees the picked object in scenes of the varied scenarios.

A scene is drawn from a seed: objects, clutter, lights, what hides a part, the camera's
errors. Nothing is simulated: it is the first image that is judged.
"""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from drake_srg.experiments.result import Row
from drake_srg.perception import AddLocalizer
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeStation
from drake_srg.types import BlobFlag, Vector

# Scenarios, and how near a sighting has to be to take the object by it [m]: half of
# what the kitchen's goal allows, and what the five-axis arm's open fingers do.
WITHIN = {"kitchen_varied": 3e-3, "assistive_arm_varied": 1.5e-3}
_ANOTHER = 0.02  # m; farther off it is another thing
_LEAST_SHARE = 0.95  # of scenes, in which the object is seen that near


@dc.dataclass(frozen=True)
class Scene:
    """What was seen in one scene.

    Attributes:
        distance: Between the best blob and the picked object [m]; NaN where there is
            no blob.
        certain: Whether the best blob says that it is.
    """

    distance: float
    certain: bool


def look(scenario_name: str, seed: int) -> Scene:
    """Draw a scene, and look for the picked object once."""
    scenario = load_scenario(scenario_name, seed=seed)
    builder = DiagramBuilder()
    station = builder.AddNamedSystem("station", MakeStation(scenario))
    localizer = AddLocalizer(builder, scenario, station)
    context = builder.Build().CreateDefaultContext()
    poses = station.GetOutputPort("object_poses_cheat").Eval(
        station.GetMyContextFromRoot(context)
    )
    blobs = localizer.GetOutputPort("blobs").Eval(
        localizer.GetMyContextFromRoot(context)
    )
    own = [blob for blob in blobs if blob.object_name == scenario.task.pick]
    if not own:
        return Scene(np.nan, False)
    best = own[0]
    truth: Vector = poses[scenario.task.pick].translation()
    return Scene(
        float(np.linalg.norm(best.position - truth)),
        BlobFlag.UNCERTAIN not in best.flags,
    )


def judge(scenario_name: str, scenes: list[Scene]) -> list[Row]:
    """Judge the scenes of a scenario."""
    distances = np.array([scene.distance for scene in scenes])
    within = WITHIN[scenario_name]
    near = float((distances <= within).mean())
    wrong = sum(s.certain and s.distance > _ANOTHER for s in scenes)
    name = f"{scenario_name}, {len(scenes)} scenes"
    seen = distances[np.isfinite(distances)]
    middle, most = (1e3 * float(np.quantile(seen, q)) for q in (0.5, 0.95))
    share = f"share seen within {1e3 * within:g} mm"
    return [
        Row.at_least(name, share, _LEAST_SHARE, near, ""),
        Row.at_most(name, "another thing is taken for it", 0.0, float(wrong), ""),
        Row.info(name, "not seen", float(np.isnan(distances).sum()), ""),
        Row.info(name, "seen, but not certain", _uncertain(scenes), ""),
        Row.info(name, "error of position, median", middle, "mm"),
        Row.info(name, "error of position, 95 % quantile", most, "mm"),
    ]


def _uncertain(scenes: list[Scene]) -> float:
    return float(sum(np.isfinite(s.distance) and not s.certain for s in scenes))
