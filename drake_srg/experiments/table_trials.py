"""Trials that take objects off a table, and their rows, tables and figure."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from drake_srg.experiments.kept_trials import KeptTrials
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.table_shares import false_claims, lay_in, shares
from drake_srg.experiments.whole_run import simulate_whole
from drake_srg.planning.grasps.top_grasps import Reach
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.scenario import load_scenario
from drake_srg.simulation.metrics import Metrics
from drake_srg.station.clearing import MakeReach

# Of a scenario: its name and its overrides.
Scenes: TypeAlias = Mapping[str, tuple[str, tuple[str, ...]]]
# Overrides that give both cameras the noise of structured light: the standard deviation
# of depth [m], and the share of pixels without depth.
NOISE = tuple(
    f"camera_errors.{camera}={{depth_noise: 0.001, depth_dropout: 0.01}}"
    for camera in ("ceiling", "bin")
)


@dc.dataclass(frozen=True)
class Limits:
    """What is asked of a scene.

    Attributes:
        cleared: Least share of the objects in reach that fit the hand (`WIDEST`).
        delivered: Least share of the picks, by ground truth.
        rate: Least picks held per hour, median of the tables [1/h].
    """

    cleared: float = 0.0
    delivered: float = 0.0
    rate: float = 0.0


@dc.dataclass(frozen=True)
class Case:
    """A scene and the seed of its objects."""

    scene: str
    seed: int

    def __str__(self) -> str:
        return f"{self.scene}, seed {self.seed}"


def run_tables(
    track: Track,
    scenes: Scenes,
    trials: int,
    seed: int,
    keep: str = "",
    *,
    place: str,
    title: str,
    limits: Mapping[str, Limits] | None = None,
) -> ExperimentResult:
    """Run every scene with every seed.

    Args:
        track: Shows progress.
        scenes: The scenes by name.
        trials: Of each scene.
        seed: Of the first trial.
        keep: See `KeptTrials`.
        place: Where the objects belong, such as `in the bin`.
        title: Of the figure.
        limits: What is asked of scenes; nothing of others.
    """
    reach = {
        name: MakeReach(load_scenario(base, overrides=overrides))
        for name, (base, overrides) in scenes.items()
    }
    runs: dict[Case, Metrics] = {}
    kept = KeptTrials(keep)
    # All scenes with one seed before any with the next.
    for case in track([Case(s, seed + i) for i in range(trials) for s in scenes]):
        run = functools.partial(run_trial, *scenes[case.scene], case.seed)
        runs[case] = Metrics(**kept(str(case), run))
    tables = {
        "trials": trial_columns(runs, place),
        "objects": object_columns(runs, scenes),
    }
    return ExperimentResult(
        judge(runs, place, limits, reach), tables, draw(runs, place, title, reach)
    )


def run_trial(name: str, overrides: Sequence[str], seed: int) -> dict[str, Any]:
    """Run a scenario without recordings, and return its metrics.

    Args:
        name: Of the scenario.
        overrides: `KEY=VALUE` each.
        seed: Of the scenario.

    Raises:
        KeyboardInterrupt: If the run was interrupted.
    """
    scenario = load_scenario(name, seed=seed, overrides=overrides)
    result = simulate_whole(scenario, name=name)
    return dc.asdict(result.metrics)


def of_scene(runs: Mapping[Case, Metrics], scene: str) -> list[Metrics]:
    """Return the metrics of a scene's trials."""
    return [m for case, m in runs.items() if case.scene == scene]


def judge(
    runs: Mapping[Case, Metrics],
    place: str,
    limits: Mapping[str, Limits] | None = None,
    reach: Mapping[str, Reach] | None = None,
) -> list[Row]:
    """Expect that limits are kept and no claim is false, and state the rest.

    Args:
        runs: The metrics of the trials.
        place: Where the objects belong.
        limits: What is asked of scenes; nothing of others.
        reach: Where the hand can be in each scene; None for everywhere.
    """
    rows = []
    for scene in dict.fromkeys(case.scene for case in runs):
        own = of_scene(runs, scene)
        limit = (limits or {}).get(scene, Limits())
        rows.append(Row.info(scene, "trials", len(own), "", spread=1.0))
        least = (0.0, limit.cleared, limit.delivered, 0.0)
        ring = (reach or {}).get(scene)
        found = shares(own, place, ring)
        for (what, share), asked in zip(found.items(), least, strict=True):
            low, high = share.bounds
            rows += [
                _asked(scene, what, asked, share.value, "", spread=0.15),
                Row.info(scene, f"{what}, at least", low, "", spread=0.15),
                Row.info(scene, f"{what}, at most", high, "", spread=0.15),
            ]
        things = [thing for m in own for thing in (m.objects or {}).values()]
        beyond = sum(not lay_in(ring, thing) for thing in things)
        rows.append(Row.info(scene, "lay out of reach", beyond, "objects", spread=3.0))
        picks = sum(m.picks or 0 for m in own)
        rows.append(Row.info(scene, "picks", picks, "", spread=3.0 + 0.3 * picks))
        rates = [m.picks_per_hour for m in own if m.picks_per_hour]
        if rates:
            rate = float(np.median(rates))
            quantity = "picks held per hour, median"
            rows.append(_asked(scene, quantity, limit.rate, rate, "1/h"))
        rows += [
            Row.info(scene, reason, count, "objects", spread=3.0 + 0.3 * count)
            for reason, count in sorted(_reasons(own).items())
        ]
        false = sum(false_claims(m) for m in own)
        rows.append(Row.at_most(scene, f"claimed, not {place}", 0.0, false, "objects"))
    return rows


def _asked(
    scene: str,
    quantity: str,
    least: float,
    value: float,
    unit: str,
    spread: float | None = None,
) -> Row:
    """Return a row that expects at least so much, if anything is asked for."""
    if least > 0.0:
        return Row.at_least(scene, quantity, least, value, unit, spread=spread)
    return Row.info(scene, quantity, value, unit, spread=spread)


def _reasons(runs: Sequence[Metrics]) -> Counter[str]:
    """Return how many objects are not in place, by their outcome."""
    return Counter(
        str(thing["outcome"])
        for m in runs
        for thing in (m.objects or {}).values()
        if not thing["cleared"]
    )


def trial_columns(runs: Mapping[Case, Metrics], place: str) -> dict[str, list[Any]]:
    """Return a line of the table for each trial."""
    table: dict[str, list[Any]] = {}
    for case, m in runs.items():
        for column, value in (
            ("scene", case.scene),
            ("seed", case.seed),
            ("success", int(m.success)),
            ("failure", m.failure or ""),
            ("objects", m.objects_total),
            (place, m.objects_cleared),
            ("picks", m.picks),
            ("held", m.picks_held),
            ("delivered", m.picks_delivered),
            ("picks per hour", m.picks_per_hour or np.nan),
            ("simulated [s]", m.sim_time_s),
        ):
            table.setdefault(column, []).append(value)
    return table


def object_columns(
    runs: Mapping[Case, Metrics], scenes: Scenes
) -> dict[str, list[Any]]:
    """Return a line of the table for each object."""
    table: dict[str, list[Any]] = {}
    for case, m in runs.items():
        name, overrides = scenes[case.scene]
        objects = load_scenario(name, seed=case.seed, overrides=overrides).objects
        for thing, outcome in (m.objects or {}).items():
            model = objects[thing].model
            for column, value in (
                ("scene", case.scene),
                ("seed", case.seed),
                ("object", model.rpartition("/")[2][:-4] if model else thing),
                ("outcome", outcome["outcome"]),
                ("attempts", outcome["attempts"]),
                ("width [m]", outcome["width_m"]),
                ("x [m]", outcome["lay_at_m"][0]),
                ("y [m]", outcome["lay_at_m"][1]),
                ("moved [m]", outcome["moved_m"]),
            ):
                table.setdefault(column, []).append(value)
    return table


def draw(
    runs: Mapping[Case, Metrics],
    place: str,
    title: str,
    reach: Mapping[str, Reach],
) -> Any:
    """Draw the shares of each scene with their intervals; see `judge`."""
    scenes = list(dict.fromkeys(case.scene for case in runs))
    found = {
        scene: shares(of_scene(runs, scene), place, reach[scene]) for scene in scenes
    }
    figure = make_figure(8.0, 1.6 + 0.5 * len(scenes), title)
    axes = figure.subplots()
    style_axes(axes, xlabel="share, with its 95 % interval")
    y = np.arange(len(scenes))[::-1]
    drawn = list(shares((), place))
    above = 0.19 * (0.5 * (len(drawn) - 1) - np.arange(len(drawn)))
    for i, what in enumerate(drawn):
        values = np.array([found[scene][what].value for scene in scenes])
        bounds = np.array([found[scene][what].bounds for scene in scenes]).T
        errors = np.maximum([values - bounds[0], bounds[1] - values], 0.0)
        axes.errorbar(
            values, y + above[i], xerr=errors, fmt="o", color=COLORS[i], label=what
        )
    axes.set_yticks(y, scenes)
    axes.set_ylim(-0.5, len(scenes) - 0.5)
    axes.set_xlim(0.0, 1.02)
    axes.legend(fontsize=8, frameon=False, loc="lower left")
    return figure
