"""A table cleared into a bin: spread objects, poured heaps, noisy depth.

The seeds are not those that the planner was tuned on (0 to 99). Published rates are not
comparable as they stand: Dex-Net 4.0 (Mahler et al., Science Robotics 4(26), 2019) took
more than 300 picks an hour at 95 % reliability from heaps of real objects, with a
parallel-jaw gripper and a suction cup; people take 400 to 600 an hour. Here all is
simulated, with one gripper, and planning takes `planner.latency`.
"""

from __future__ import annotations

import dataclasses as dc
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.recording.figure import COLORS, make_figure, style_axes
from drake_srg.scenario import load_scenario
from drake_srg.simulation.metrics import Metrics
from drake_srg.simulation.simulate import Simulate
from drake_srg.sweeps.statistics import wilson_interval

# Of structured light: the standard deviation of depth [m], and the share of pixels
# without depth.
_NOISE = "camera_errors.ceiling={depth_noise: 0.001, depth_dropout: 0.01}"
SCENES: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "spread": ("clear_table_fast", ()),
    "spread, noise": ("clear_table_fast", (_NOISE,)),
    "heap, noise": ("clear_heap_fast", (_NOISE,)),
}


@dc.dataclass(frozen=True)
class Case:
    """A scene and the seed of its objects."""

    scene: str
    seed: int

    def __str__(self) -> str:
        return f"{self.scene}, seed {self.seed}"


def run(track: Track, *, trials: int = 8, seed: int = 8000) -> ExperimentResult:
    """Clear the table in every scene.

    Args:
        track: Shows progress.
        trials: Of each scene.
        seed: Of the first trial.
    """
    runs: dict[Case, Metrics] = {}
    # All scenes with one seed before any with the next.
    for case in track([Case(s, seed + i) for i in range(trials) for s in SCENES]):
        name, overrides = SCENES[case.scene]
        scenario = load_scenario(name, seed=case.seed, overrides=overrides)
        runs[case] = Simulate(scenario, name=name).metrics
    tables = {"trials": trial_columns(runs), "objects": object_columns(runs)}
    return ExperimentResult(judge(runs), tables, draw(runs))


@dc.dataclass(frozen=True)
class Share:
    """Successes among trials."""

    count: int
    total: int

    @property
    def value(self) -> float:
        """Their share; 0 without trials."""
        return self.count / max(self.total, 1)

    @property
    def bounds(self) -> tuple[float, float]:
        """The 95 % interval (Wilson)."""
        return wilson_interval(self.count, self.total)


def shares(runs: Sequence[Metrics]) -> dict[str, Share]:
    """Return the shares of objects cleared and of picks held."""
    total = {
        key: sum(getattr(m, key) or 0 for m in runs)
        for key in ("objects_total", "objects_cleared", "picks", "picks_held")
    }
    return {
        "objects in the bin": Share(total["objects_cleared"], total["objects_total"]),
        "picks held": Share(total["picks_held"], total["picks"]),
    }


def of_scene(runs: Mapping[Case, Metrics], scene: str) -> list[Metrics]:
    """Return the metrics of a scene's trials."""
    return [m for case, m in runs.items() if case.scene == scene]


def judge(runs: Mapping[Case, Metrics]) -> list[Row]:
    """Expect that no claim is false, and state the rest."""
    rows = []
    for scene in dict.fromkeys(case.scene for case in runs):
        own = of_scene(runs, scene)
        rows.append(Row.info(scene, "trials", len(own), "", spread=1.0))
        for what, share in shares(own).items():
            low, high = share.bounds
            for suffix, value in (
                ("", share.value),
                (", at least", low),
                (", at most", high),
            ):
                rows.append(Row.info(scene, f"{what}{suffix}", value, "", spread=0.15))
        rates = [m.picks_per_hour for m in own if m.picks_per_hour]
        if rates:
            rate = float(np.median(rates))
            rows.append(Row.info(scene, "picks held per hour, median", rate, "1/h"))
        reasons = Counter(
            str(thing["outcome"])
            for m in own
            for thing in (m.objects or {}).values()
            if not thing["cleared"]
        )
        for reason, count in sorted(reasons.items()):
            rows.append(
                Row.info(scene, reason, count, "objects", spread=3.0 + 0.3 * count)
            )
        claimed = sum(
            max((m.picks_held or 0) - (m.objects_cleared or 0), 0) for m in own
        )
        rows.append(
            Row.at_most(scene, "claimed, not in the bin", 0.0, claimed, "objects")
        )
    return rows


def trial_columns(runs: Mapping[Case, Metrics]) -> dict[str, list[Any]]:
    """Return a line of the table for each trial."""
    table: dict[str, list[Any]] = {}
    for case, m in runs.items():
        for column, value in (
            ("scene", case.scene),
            ("seed", case.seed),
            ("success", int(m.success)),
            ("failure", m.failure or ""),
            ("objects", m.objects_total),
            ("in the bin", m.objects_cleared),
            ("picks", m.picks),
            ("held", m.picks_held),
            ("picks per hour", m.picks_per_hour or np.nan),
            ("simulated [s]", m.sim_time_s),
        ):
            table.setdefault(column, []).append(value)
    return table


def object_columns(runs: Mapping[Case, Metrics]) -> dict[str, list[Any]]:
    """Return a line of the table for each object."""
    table: dict[str, list[Any]] = {}
    for case, m in runs.items():
        name, overrides = SCENES[case.scene]
        objects = load_scenario(name, seed=case.seed, overrides=overrides).objects
        for thing, outcome in (m.objects or {}).items():
            for column, value in (
                ("scene", case.scene),
                ("seed", case.seed),
                ("object", str(objects[thing].model).rpartition("/")[2][:-4]),
                ("outcome", outcome["outcome"]),
                ("attempts", outcome["attempts"]),
            ):
                table.setdefault(column, []).append(value)
    return table


def draw(runs: Mapping[Case, Metrics]) -> Any:
    """Draw the shares of each scene with their intervals."""
    scenes = list(dict.fromkeys(case.scene for case in runs))
    figure = make_figure(8.0, 1.6 + 0.5 * len(scenes), "Tables cleared into a bin")
    axes = figure.subplots()
    style_axes(axes, xlabel="share, with its 95 % interval")
    y = np.arange(len(scenes))[::-1]
    for i, what in enumerate(("objects in the bin", "picks held")):
        found = [shares(of_scene(runs, scene))[what] for scene in scenes]
        values = np.array([share.value for share in found])
        bounds = np.array([share.bounds for share in found]).T
        errors = np.maximum([values - bounds[0], bounds[1] - values], 0.0)
        place = y + 0.15 * (1 - 2 * i)
        axes.errorbar(values, place, xerr=errors, fmt="o", color=COLORS[i], label=what)
    axes.set_yticks(y, scenes)
    axes.set_ylim(-0.5, len(scenes) - 0.5)
    axes.set_xlim(0.0, 1.02)
    axes.legend(fontsize=8, frameon=False, loc="lower left")
    return figure
