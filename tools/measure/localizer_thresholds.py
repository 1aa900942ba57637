"""What half and twice each of the localizer's thresholds do to what it sees.

Scenes of the varied scenarios are drawn from seeds, their images made once, and looked
at with one threshold after the other changed: with the camera's errors and without
them, the arm's cylinder also as it leans, lies and hangs. Nothing is simulated.
"""

from __future__ import annotations

import dataclasses as dc
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import ModuleType
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.experiments.varied_scenes import (
    ANOTHER,
    WITHIN,
    Obstacles,
    Scene,
    Scenery,
)
from drake_srg.types import Cylinder
from drake_srg.vision import obstacles
from measure.thresholds import THRESHOLDS, Setting, show
from measure.thresholds_figure import draw

_KITCHEN, _ARM = WITHIN
_STANDING, _CLEAR, _LEANING, _HARDER = "", "clear images", "leaning", "harder"
_MOST_TURN = np.deg2rad(5.0)  # as far as what is set down may lean
_HIGHEST = 0.1  # m; a hand lifts no higher where the camera looks
_OVERRIDES: dict[str, list[str]] = {
    _STANDING: [],
    _CLEAR: ["camera_errors={}", "object.known_scale=1.0"],
    _LEANING: ["object.occlusion=null"],
    # What the scenarios vary, and beyond: where thresholds are more likely to matter.
    _HARDER: [
        "clutter.count=4",
        "object.occlusion.share=!Uniform {min: 0.3, max: 0.5}",
    ],
}
_UP = np.array([0.0, 0.0, 1.0])
# Scenes; five of five alike are by chance in 1 of 32 cases, four in 1 of 16.
_CHANCE = 4
_LEAST_NEAR = 0.95  # of scenes, as in varied_scenes
_LESS = 0.9  # of an error; what is less than that is worth another value


@dc.dataclass(frozen=True)
class Group:
    """Scenes that have something in common.

    Attributes:
        scenario: Whose.
        way: What is special about them.
        seeds: Of the scenes.
        modules: Whose thresholds are tried in them; all, if empty.
    """

    scenario: str
    way: str
    seeds: range
    modules: tuple[ModuleType, ...] = ()

    def __str__(self) -> str:
        return f"{self.scenario}, {self.way}" if self.way else self.scenario

    def make(self, seed: int) -> Scenery:
        """Draw a scene."""
        scenery = Scenery(self.scenario, seed, _OVERRIDES[self.way])
        if self.way == _LEANING:
            assert isinstance(scenery.shape, Cylinder)
            scenery.put(lean(scenery.pose(), scenery.shape, seed))
        return scenery


@dc.dataclass(frozen=True)
class Look:
    """What was seen of a scene with a setting, and how long it took [s]."""

    group: Group
    scene: Scene
    obstacles: Obstacles
    duration: float

    @property
    def near(self) -> bool:
        """Whether the object can be taken by it."""
        within = self.scene.distance <= WITHIN[self.group.scenario]
        return within and self.scene.turn <= _MOST_TURN

    @property
    def deceived(self) -> bool:
        """Whether it would be taken by it though it cannot."""
        return self.scene.certain and not self.near

    @property
    def loss(self) -> int:
        """How bad that is: what is not taken, and once more what is taken wrongly."""
        taken = self.near and self.scene.certain
        object_lost = (not taken) + self.deceived
        return object_lost + self.obstacles.missed + self.obstacles.invented


Looks = dict[Setting, dict[tuple[Group, int], Look]]  # by group and seed

GROUPS = (
    Group(_KITCHEN, _STANDING, range(8)),
    Group(_ARM, _STANDING, range(12)),
    Group(_KITCHEN, _HARDER, range(5)),
    Group(_ARM, _HARDER, range(3)),
    Group(_ARM, _LEANING, range(6)),
    Group(_KITCHEN, _CLEAR, range(2)),
    Group(_ARM, _CLEAR, range(2)),
    Group(_KITCHEN, _STANDING, range(8, 40), (obstacles,)),
)


def lean(X_WO: RigidTransform, shape: Cylinder, seed: int) -> RigidTransform:
    """Turn what stands: with an even seed it then touches its table, else it hangs."""
    rng = np.random.default_rng(seed)
    tilt, azimuth = rng.uniform(0.0, np.pi / 2), rng.uniform(-np.pi, np.pi)
    level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    axis = np.sin(tilt) * level + np.cos(tilt) * _UP
    R_WO = RotationMatrix.MakeFromOneVector(axis, 2)
    half = 0.5 * shape.length
    lift = half * np.cos(tilt) + shape.radius * np.sin(tilt) - half
    lift += rng.uniform(0.0, _HIGHEST) * (seed % 2)
    return RigidTransform(R_WO, X_WO.translation() + lift * _UP)


def run(track: Track) -> ExperimentResult:
    """Look at all scenes with all settings."""
    looks: Looks = {}
    scenes = [(group, seed) for group in GROUPS for seed in group.seeds]
    for group, seed in track(scenes, lambda scene: f"{scene[0]}, {scene[1]}"):
        for setting, look in look_at(group.make(seed), group):
            looks.setdefault(setting, {})[group, seed] = look
    return make_result(looks)


def look_at(scenery: Scenery, group: Group) -> Iterator[tuple[Setting, Look]]:
    """Look at a scene, first with the values in use, then with others in their place.

    While a value is tried, the module's constant is that; then what it was before.
    """
    scene = scenery.look()  # what an image takes the first time is not looking
    for setting in settings(group):
        before = time.process_time()
        with setting.in_place():
            if setting.threshold is None or setting.threshold.module is not obstacles:
                scene = scenery.look()
            found = scenery.find_obstacles()
        yield setting, Look(group, scene, found, time.process_time() - before)


def settings(group: Group) -> list[Setting]:
    """Return what is tried in a group of scenes, the values in use first.

    Those of obstacles follow, so that what was seen of the object is as in use.
    """
    return [Setting()] + [
        Setting(threshold, i)
        for threshold in sorted(THRESHOLDS, key=lambda t: t.module is not obstacles)
        if not group.modules or threshold.module in group.modules
        for i in range(2)
    ]


def make_result(looks: Looks) -> ExperimentResult:
    """Judge what was seen, by setting; the values in use are among them."""
    used = looks[Setting()]
    kinds = list(dict.fromkeys(kind(group) for group, _ in used))
    table: dict[str, list[Any]] = {}
    changes = []
    drawn: dict[str, list[tuple[float, ...]]] = {}
    for setting, seen in looks.items():
        change = Change.of(seen, used, kinds)
        changes.append((setting, change))
        if setting.threshold:
            bars = drawn.setdefault(str(setting.threshold), [])
            bars.append((change.better - change.worse, *change.errors))
        for column, value in columns(setting, seen, change, kinds).items():
            table.setdefault(column, []).append(value)
    return ExperimentResult(
        judge(list(used.values()), changes, kinds),
        {"values": table},
        draw(
            drawn, ["scenes better, less worse", *(f"error ratio, {k}" for k in kinds)]
        ),
    )


def kind(group: Group) -> str:
    """Return of which scenes errors are taken together."""
    return _CLEAR if group.way == _CLEAR else group.scenario


@dc.dataclass(frozen=True)
class Change:
    """What another value changes.

    Attributes:
        better: Scenes of which less is lost.
        worse: Scenes of which more is lost.
        errors: Root mean square distance over that with the values in use, of what is
            near with both, by kind of scenes.
    """

    better: int
    worse: int
    errors: tuple[float, ...]

    @property
    def harmless(self) -> bool:
        """Whether no more is lost, and no error is clearly larger."""
        return self.better >= self.worse and max(self.errors) <= 1.0 / _LESS

    @classmethod
    def of(
        cls,
        seen: Mapping[tuple[Group, int], Look],
        used: Mapping[tuple[Group, int], Look],
        kinds: Sequence[str],
    ) -> Change:
        """Compare what was seen with what is seen with the values in use."""
        pairs = [(look, used[scene]) for scene, look in seen.items()]
        near = [(look, own) for look, own in pairs if look.near and own.near]
        errors = [
            np.array([p for p in near if kind(p[0].group) == k], dtype=object).T
            for k in kinds
        ]
        ratios = [rms(e[0]) / rms(e[1]) if e.size else 1.0 for e in errors]
        return cls(
            sum(look.loss < own.loss for look, own in pairs),
            sum(look.loss > own.loss for look, own in pairs),
            tuple(ratios),
        )


def rms(looks: Iterable[Look]) -> float:
    """Root mean square distance [m]; NaN of none."""
    squares = [look.scene.distance**2 for look in looks]
    return float(np.sqrt(np.mean(squares))) if squares else np.nan


def columns(
    setting: Setting,
    seen: Mapping[tuple[Group, int], Look],
    change: Change,
    kinds: Sequence[str],
) -> dict[str, Any]:
    """Return a line of the table."""
    looks = list(seen.values())
    near = [look for look in looks if look.near]
    heights = [e for look in looks for e in look.obstacles.errors]
    mean, least = (f(heights) if heights else np.nan for f in (np.mean, np.min))
    of_kinds = {
        f"error, {k} [mm]": 1e3 * rms(look for look in near if kind(look.group) == k)
        for k in kinds
    }
    distances = [look.scene.distance for look in near]
    most = 1e3 * float(np.quantile(distances, 0.95)) if near else np.nan
    return {
        "threshold": str(setting.threshold or "all"),
        "value": show(setting.value) if setting.threshold else "in use",
        "scenes": len(looks),
        "better": change.better,
        "worse": change.worse,
        "seen near": len(near),
        "near, but not certain": sum(not look.scene.certain for look in near),
        "certain, but not near": sum(look.deceived for look in looks),
        "another thing": sum(look.scene.distance > ANOTHER for look in looks),
        "not seen": sum(bool(np.isnan(look.scene.distance)) for look in looks),
        **of_kinds,
        "error, 95 % quantile [mm]": most,
        "obstacles missed": sum(look.obstacles.missed for look in looks),
        "obstacles invented": sum(look.obstacles.invented for look in looks),
        "obstacles too high, mean [mm]": 1e3 * float(mean),
        "obstacles too high, least [mm]": 1e3 * float(least),
        "time a scene [ms]": 1e3 * float(np.mean([look.duration for look in looks])),
    }


def judge_used(used: Sequence[Look]) -> list[Row]:
    """Judge the values in use; in scenes that no scenario shows, only whether sure."""
    rows = []
    for group in dict.fromkeys(str(look.group) for look in used):
        looks = [look for look in used if str(look.group) == group]
        name = f"{group}, {len(looks)} scenes"
        near = float(np.mean([look.near for look in looks]))
        share = "share seen near enough"
        deceived = sum(look.deceived for look in looks)
        rows.append(Row.at_most(name, "certain, but not near", 0.0, deceived, ""))
        numbers = {
            "obstacles missed": sum(look.obstacles.missed for look in looks),
            "obstacles invented": sum(look.obstacles.invented for look in looks),
        }
        if looks[0].group.way in (_STANDING, _CLEAR):
            rows.append(Row.at_least(name, share, _LEAST_NEAR, near, ""))
            rows += [Row.at_most(name, k, 0.0, n, "") for k, n in numbers.items()]
        else:
            rows.append(Row.info(name, share, near, ""))
            rows += [Row.info(name, k, n, "") for k, n in numbers.items()]
    return rows


def judge(
    used: Sequence[Look],
    changes: Sequence[tuple[Setting, Change]],
    kinds: Sequence[str],
) -> list[Row]:
    """Judge the values in use, and whether others are better."""
    rows = judge_used(used)
    tried = [(setting, change) for setting, change in changes if setting.threshold]
    for i, of_kind in enumerate(kinds):
        error = 1e3 * rms(k for k in used if k.near and kind(k.group) == of_kind)
        rows.append(Row.info(of_kind, "error, root mean square", error, "mm"))
        if errors := [(c.errors[i], str(s)) for s, c in tried if c.harmless]:
            least, best = min(errors)
            what = f"error over that of the value in use, {of_kind}; the least"
            rows.append(Row.at_least(best, what, _LESS, least, ""))
    for setting, change in tried:
        assert setting.threshold is not None
        what = f"scenes better than with {show(setting.threshold.used)}, less worse"
        gain = change.better - change.worse
        rows.append(Row.at_most(str(setting), what, _CHANCE, gain, ""))
    return rows
