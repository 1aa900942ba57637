"""Where the localizer sees the picked object in scenes of the varied scenarios.

A scene is drawn from a seed: objects, clutter, lights, what hides a part, the camera's
errors. Nothing is simulated: it is the first image that is judged.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from drake_srg.cell.perception import AddLocalizer, AddObstacleFinder
from drake_srg.experiments.result import Row
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import simple_shape
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeStation
from drake_srg.types import BlobFlag, Obstacle, Shape
from drake_srg.vision.solids import bounding_size

# Scenarios, and how near a sighting has to be to take the object by it [m]: half of
# what the kitchen's goal allows, and what the five-axis arm's open fingers do.
WITHIN = {"kitchen_varied": 3e-3, "assistive_arm_varied": 1.5e-3}
ANOTHER = 0.02  # m; farther off it is another thing
_LEAST_SHARE = 0.95  # of scenes, in which the object is seen that near
_LOW = 0.008  # m; ObstacleFinder's min_height: lower things need not be found


@dc.dataclass(frozen=True)
class Scene:
    """What was seen in one scene.

    Attributes:
        distance: Between the best blob and the picked object [m]; NaN where there is
            no blob.
        certain: Whether the best blob says that it is.
        turn: Between their axes [rad], likewise; both ends look alike.
    """

    distance: float
    certain: bool
    turn: float = 0.0


@dc.dataclass(frozen=True)
class Obstacles:
    """What was found of the clutter in one scene.

    Attributes:
        missed: How many things in which no obstacle is.
        invented: How many obstacles in which no thing is.
        errors: Of the heights of those that are one thing [m].
    """

    missed: int
    invented: int
    errors: tuple[float, ...]


class Scenery:
    """A scene whose images are made once, and may be looked at many times.

    Args:
        scenario_name: A scenario whose localizer finds obstacles.
        seed: What the scene is drawn from.
        overrides: As those of `load_scenario`.
    """

    def __init__(self, scenario_name: str, seed: int, overrides: Sequence[str] = ()):
        self._scenario = load_scenario(scenario_name, seed=seed, overrides=overrides)
        builder = DiagramBuilder()
        self._station = builder.AddNamedSystem("station", MakeStation(self._scenario))
        self._localizer = AddLocalizer(builder, self._scenario, self._station)
        self._finder = AddObstacleFinder(
            builder, self._scenario, self._station, self._localizer
        )
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()

    @property
    def shape(self) -> Shape | None:
        """The true shape of the picked object; None where it is no simple one."""
        name = self._scenario.task.pick
        return simple_shape(name, self._scenario.objects[name])

    def pose(self) -> RigidTransform:
        """X_WO of the picked object."""
        return self._poses()[self._scenario.task.pick]

    def put(self, X_WO: RigidTransform) -> None:
        """Put the picked object somewhere."""
        plant = self._station.GetSubsystemByName("plant")
        model = plant.GetModelInstanceByName(self._scenario.task.pick)
        (index,) = plant.GetBodyIndices(model)
        plant.SetFreeBodyPose(
            plant.GetMyMutableContextFromRoot(self._context),
            plant.get_body(index),
            X_WO,
        )

    def look(self) -> Scene:
        """Look for the picked object, anew but in the same images."""
        blobs = self._anew(self._localizer)
        own = [b for b in blobs if b.object_name == self._scenario.task.pick]
        if not own:
            return Scene(np.nan, False, np.nan)
        best, X_WO = own[0], self.pose()
        axis = X_WO.rotation().matrix()[:, 2]
        turn = np.arctan2(np.linalg.norm(np.cross(best.axis, axis)), best.axis @ axis)
        return Scene(
            float(np.linalg.norm(best.position - X_WO.translation())),
            BlobFlag.UNCERTAIN not in best.flags,
            float(min(turn, np.pi - turn)),
        )

    def find_obstacles(self) -> Obstacles:
        """Find what is in the way, anew but in the same images and as last seen."""
        poses = self._poses()
        things = [
            (poses[name], config)
            for name, config in self._scenario.objects.items()
            if not config.known
        ]
        return match(self._anew(self._finder), things)

    def _poses(self) -> dict[str, RigidTransform]:
        port = self._station.GetOutputPort("object_poses_cheat")
        poses: dict[str, RigidTransform] = port.Eval(
            self._station.GetMyContextFromRoot(self._context)
        )
        return poses

    def _anew(self, system: LeafSystem) -> Any:
        """A system's output, computed even if its inputs are the same."""
        context = system.GetMyContextFromRoot(self._context)
        context.SetAllCacheEntriesOutOfDate()
        return system.get_output_port().Eval(context)


def match(
    found: Sequence[Obstacle], things: Sequence[tuple[RigidTransform, ObjectConfig]]
) -> Obstacles:
    """Compare obstacles with the upright things that are there, seen from above.

    A thing is found by an obstacle that its middle is in. An obstacle is of a thing
    that it finds, or whose surrounding circle its own middle is in.
    """
    sizes = [
        bounding_size(shape) if (shape := simple_shape("", config)) else np.zeros(3)
        for _, config in things
    ]
    middles = [X_WO.translation() for X_WO, _ in things]
    holds = np.zeros((len(found), len(things)), bool)
    touches = holds.copy()
    for i, obstacle in enumerate(found):
        half = 0.5 * np.array(obstacle.shape.size[:2])
        for j, (middle, size) in enumerate(zip(middles, sizes, strict=True)):
            p_O = (obstacle.X_WO.inverse() @ middle)[:2]
            holds[i, j] = (np.abs(p_O) <= half).all()
            near = np.linalg.norm(p_O) <= 0.5 * np.linalg.norm(size[:2])
            touches[i, j] = holds[i, j] or near
    high = np.array([size[2] > _LOW for size in sizes], bool)
    errors = tuple(
        float(found[i].shape.height - sizes[j][2])
        for i, j in np.argwhere(holds & high)
        if holds[i].sum() == 1  # of several together it is the highest one's
    )
    return Obstacles(
        missed=int((high & ~holds.any(axis=0)).sum()),
        invented=int((~touches.any(axis=1)).sum()),
        errors=errors,
    )


def look(scenario_name: str, seed: int) -> Scene:
    """Draw a scene, and look for the picked object once."""
    return Scenery(scenario_name, seed).look()


def judge(scenario_name: str, scenes: list[Scene]) -> list[Row]:
    """Judge the scenes of a scenario."""
    distances = np.array([scene.distance for scene in scenes])
    within = WITHIN[scenario_name]
    near = float((distances <= within).mean())
    wrong = sum(s.certain and s.distance > ANOTHER for s in scenes)
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
