"""How other values of each vision threshold change what the localizer sees.

Scenes of the varied scenarios are drawn from seeds, rendered once, and perceived with
one threshold after another changed: with and without the camera's errors, and with the
arm's cylinder leaning, lying and hanging. Nothing is simulated.
"""

from __future__ import annotations

import dataclasses as dc
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.varied_scenes import ANOTHER, Scenery
from measure.threshold_scenes import CLEAR, GROUPS, STANDING, Group, Look, Looks
from measure.thresholds import THRESHOLDS, Setting, show
from measure.thresholds_figure import draw

# A value must be better in more scenes than this. Five of five alike happen by chance
# in 1 of 32 cases, four of four in 1 of 16.
_CHANCE = 4
_LEAST_NEAR = 0.95  # share of scenes, as in varied_scenes
_LESS = 0.9  # ratio of errors; a smaller one is worth another value


def run(track: Track, *, only: str = "") -> ExperimentResult:
    """Perceive all scenes with all settings.

    Args:
        track: Shows progress.
        only: Beginning of the names of the thresholds to try; empty: all.
    """
    looks: Looks = {}
    scenes = [(group, seed) for group in GROUPS for seed in group.seeds]
    for group, seed in track(scenes, lambda scene: f"{scene[0]}, {scene[1]}"):
        for setting, look in look_at(group.make(seed), group, only):
            looks.setdefault(setting, {})[group, seed] = look
    return make_result(looks)


def look_at(
    scenery: Scenery, group: Group, only: str = ""
) -> Iterator[tuple[Setting, Look]]:
    """Perceive a scene with the values in use, then with each other value."""
    scenery.look()  # renders the images, which is not part of perceiving them
    for setting in settings(group, only):
        before = time.process_time()
        scene, obstacles = scenery.look(setting.config())
        yield setting, Look(group, scene, obstacles, time.process_time() - before)


def settings(group: Group, only: str = "") -> list[Setting]:
    """Return the settings for a group of scenes, the values in use first."""
    return [Setting()] + [
        Setting(threshold, i)
        for threshold in THRESHOLDS
        if threshold.path.startswith(only) and threshold.path.startswith(group.step)
        for i in range(2)
    ]


def make_result(looks: Looks) -> ExperimentResult:
    """Judge what was seen with each setting, the values in use among them."""
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
    """Return the name under which errors of a group are averaged."""
    return CLEAR if group.way == CLEAR else group.scenario


@dc.dataclass(frozen=True)
class Change:
    """What another value changes.

    Attributes:
        better: Number of scenes with less loss.
        worse: Number of scenes with more loss.
        errors: Root mean square distance over that with the values in use, for each
            kind of scenes, from scenes that are near with both.
    """

    better: int
    worse: int
    errors: tuple[float, ...]

    @property
    def harmless(self) -> bool:
        """Whether the loss is no greater and no error is clearly larger."""
        return self.better >= self.worse and max(self.errors) <= 1.0 / _LESS

    @classmethod
    def of(
        cls,
        seen: Mapping[tuple[Group, int], Look],
        used: Mapping[tuple[Group, int], Look],
        kinds: Sequence[str],
    ) -> Change:
        """Compare what was seen with what the values in use show."""
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
    """Return the root mean square distance [m]; NaN without looks."""
    squares = [look.scene.distance**2 for look in looks]
    return float(np.sqrt(np.mean(squares))) if squares else np.nan


def columns(
    setting: Setting,
    seen: Mapping[tuple[Group, int], Look],
    change: Change,
    kinds: Sequence[str],
) -> dict[str, Any]:
    """Return a row of the table."""
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
    """Judge the values in use.

    In scenes that no scenario draws, only false certainty counts.
    """
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
        if looks[0].group.way in (STANDING, CLEAR):
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
    """Judge the values in use and whether others are better."""
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
        # Chance may also turn as many scenes between two runs.
        chance = float(_CHANCE)
        rows.append(Row.at_most(str(setting), what, chance, gain, "", spread=chance))
    return rows
