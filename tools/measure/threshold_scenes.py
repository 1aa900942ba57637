"""The scenes in which thresholds of vision are tried."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.experiments.varied_scenes import WITHIN, Obstacles, Scene, Scenery
from drake_srg.types import Cylinder
from measure.thresholds import Setting

KITCHEN, ARM = WITHIN
STANDING, CLEAR, LEANING, HARDER = "", "clear images", "leaning", "harder"
_MOST_TURN = np.deg2rad(5.0)  # a placed object may lean as much
_HIGHEST = 0.1  # a hand lifts no higher where the camera looks [m]
_OVERRIDES: dict[str, list[str]] = {
    STANDING: [],
    CLEAR: ["camera_errors={}", "object.known_scale=1.0"],
    LEANING: ["object.occlusion=null"],
    # More than the scenarios vary: thresholds are more likely to matter here.
    HARDER: [
        "clutter.count=4",
        "object.occlusion.share=!Uniform {min: 0.3, max: 0.5}",
    ],
}
_UP = np.array([0.0, 0.0, 1.0])


@dc.dataclass(frozen=True)
class Group:
    """Scenes that have something in common.

    Attributes:
        scenario: The scenario that draws them.
        way: What is special about them, a key of `_OVERRIDES`.
        seeds: Their seeds.
        step: Only thresholds of this step are tried, such as "obstacles"; empty: all.
    """

    scenario: str
    way: str
    seeds: range
    step: str = ""

    def __str__(self) -> str:
        return f"{self.scenario}, {self.way}" if self.way else self.scenario

    def make(self, seed: int) -> Scenery:
        """Draw a scene."""
        scenery = Scenery(self.scenario, seed, _OVERRIDES[self.way])
        if self.way == LEANING:
            assert isinstance(scenery.shape, Cylinder)
            scenery.put(lean(scenery.pose(), scenery.shape, seed))
        return scenery


@dc.dataclass(frozen=True)
class Look:
    """How a scene was perceived with a setting.

    Attributes:
        group: The scene's group.
        scene: How the picked object was located.
        obstacles: How the clutter was found.
        duration: Processor time [s].
    """

    group: Group
    scene: Scene
    obstacles: Obstacles
    duration: float

    @property
    def near(self) -> bool:
        """Whether the object was located well enough to be picked."""
        within = self.scene.distance <= WITHIN[self.group.scenario]
        return within and self.scene.turn <= _MOST_TURN

    @property
    def deceived(self) -> bool:
        """Whether a wrong location would be trusted."""
        return self.scene.certain and not self.near

    @property
    def loss(self) -> int:
        """How bad it is: 1 if the object is lost, 2 if a wrong location is trusted.

        Each missed or invented obstacle adds 1.
        """
        picked = self.near and self.scene.certain
        object_lost = (not picked) + self.deceived
        return object_lost + self.obstacles.missed + self.obstacles.invented


Looks = dict[Setting, dict[tuple[Group, int], Look]]  # by group and seed

GROUPS = (
    Group(KITCHEN, STANDING, range(8)),
    Group(ARM, STANDING, range(12)),
    Group(KITCHEN, HARDER, range(5)),
    Group(ARM, HARDER, range(3)),
    Group(ARM, LEANING, range(6)),
    Group(KITCHEN, CLEAR, range(2)),
    Group(ARM, CLEAR, range(2)),
    Group(KITCHEN, STANDING, range(8, 40), "obstacles"),
)


def lean(X_WO: RigidTransform, shape: Cylinder, seed: int) -> RigidTransform:
    """Tilt a standing cylinder: with an even seed it touches the table, else it hangs.

    Args:
        X_WO: Its pose as it stands.
        shape: The cylinder.
        seed: The seed of tilt and height.
    """
    rng = np.random.default_rng(seed)
    tilt, azimuth = rng.uniform(0.0, np.pi / 2), rng.uniform(-np.pi, np.pi)
    level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    axis = np.sin(tilt) * level + np.cos(tilt) * _UP
    R_WO = RotationMatrix.MakeFromOneVector(axis, 2)
    half = 0.5 * shape.length
    lift = half * np.cos(tilt) + shape.radius * np.sin(tilt) - half
    lift += rng.uniform(0.0, _HIGHEST) * (seed % 2)
    return RigidTransform(R_WO, X_WO.translation() + lift * _UP)
