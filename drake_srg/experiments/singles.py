"""One thing at a time cleared into a bin: household objects, shapes and new meshes.

It falls on the table in any orientation. The planner sees a noisy depth image and knows
nothing of it. Whether it offers a side that the hand takes is judged here, by ground
truth: the distance of two parallel vertical planes that enclose it where it rests.
"""

from __future__ import annotations

import dataclasses as dc
import functools
import tempfile
import time as clock
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drake_srg.common.log_format import MODES
from drake_srg.experiments.kept_trials import KeptTrials
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.single_things import (
    HOUSEHOLD_THINGS,
    MESHES,
    SHAPES,
    thing,
    write_meshes,
)
from drake_srg.experiments.table_shares import WIDEST, Share
from drake_srg.experiments.table_trials import NOISE
from drake_srg.experiments.whole_run import simulate_whole
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.scenario import load_scenario
from drake_srg.types import Mode, Vector

SCENARIO = "clear_table_fast"
GROUPS = (HOUSEHOLD_THINGS, SHAPES, MESHES)
_THING = "thing"
# What is asked for: shares that are in the bin after the first grasp and after three,
# picks per hour, and processor time of a trial [s], so that two workers take half.
FIRST, ANY, RATE, MOST_TIME = 0.97, 0.997, 650.0, 4.0


@dc.dataclass(frozen=True)
class Single:
    """One trial.

    Attributes:
        group: Of the thing.
        seed: Of the trial.
        kind: The model's name, or the shape's.
        width: See `ObjectOutcome` [m].
        cleared: Whether it rests in the bin.
        picks: Grasps begun.
        claimed: Whether the planner says that it is in the bin.
        outcome: See `ObjectOutcome`.
        pick_time: From the first plan until the hand has let go, simulated; NaN without
            a pick [s].
        time: Processor time of the whole trial [s].
    """

    group: str
    seed: int
    kind: str
    width: float
    cleared: bool
    picks: int
    claimed: bool
    outcome: str
    pick_time: float
    time: float


def run(
    track: Track, *, trials: int = 1000, seed: int = 1_110_000, keep: str = ""
) -> ExperimentResult:
    """Clear single things.

    Args:
        track: Shows progress.
        trials: Of all groups together.
        seed: Of the first trial.
        keep: File of finished trials, with which a run that was cut off goes on.
    """
    kept, made = KeptTrials(keep), []
    with tempfile.TemporaryDirectory() as folder:
        write_meshes(Path(folder))
        for own in track(range(seed, seed + trials), lambda own: f"seed {own}"):
            run = functools.partial(run_single, own, Path(folder))
            made.append(Single(**kept(f"seed {own}", run)))
    return ExperimentResult(judge(made), {"trials": columns(made)}, draw(made))


def run_single(seed: int, folder: Path) -> dict[str, Any]:
    """Run a trial; returns the fields of `Single`.

    Args:
        seed: Of the trial; chooses group and kind in turn.
        folder: Of the meshes.

    Raises:
        KeyboardInterrupt: If the run was interrupted.
    """
    start = clock.process_time()
    turn, of_group = divmod(seed, len(GROUPS))
    group = GROUPS[of_group]
    own = f"objects={{{_THING}: {thing(group, turn, folder)}}}"
    scenario = load_scenario(
        SCENARIO, seed=seed, overrides=(*NOISE, "clutter.count=0", own)
    )
    result = simulate_whole(scenario, name=SCENARIO)
    config, metrics, log = scenario.objects[_THING], result.metrics, result.log
    assert metrics.objects is not None
    outcome = metrics.objects[_THING]
    kind = Path(config.model).stem if config.model else type(config.shape).__name__
    mode = np.array([MODES[int(i)].value for i in log["mode"]])
    single = Single(
        group=group,
        seed=seed,
        kind=kind,
        width=float(outcome["width_m"]),
        cleared=bool(outcome["cleared"]),
        picks=metrics.picks or 0,
        claimed=bool(metrics.picks_held),
        outcome=str(outcome["outcome"]),
        pick_time=_pick_time(log["time"], mode, scenario.planner.latency),
        time=clock.process_time() - start,
    )
    return dc.asdict(single)


def _pick_time(time: Vector, mode: Any, latency: float) -> float:
    """Return the time from the first plan until the first load is let go [s]."""
    begun = np.flatnonzero(mode == Mode.PRE_GRASP.value)
    released = np.flatnonzero(mode == Mode.RELEASE.value)
    if not len(begun) or not len(released):
        return float("nan")
    # The end of the first release: the next sample in another mode.
    after = np.flatnonzero(mode[released[0] :] != Mode.RELEASE.value)
    end = released[0] + (after[0] if len(after) else len(mode) - 1 - released[0])
    return float(time[end] - time[begun[0]] + latency)


def graspable(made: Sequence[Single]) -> list[Single]:
    """Return the trials whose thing has a side that counts."""
    return [one for one in made if one.width <= WIDEST]


def first(made: Sequence[Single]) -> Share:
    """Return the share that is in the bin after the first grasp."""
    return Share(sum(one.cleared and one.picks == 1 for one in made), len(made))


def judge(made: Sequence[Single]) -> list[Row]:
    """Expect what is asked for of all; state it for each group."""
    rows = [Row.info("all", "trials", len(made), "", spread=1.0)]
    own = graspable(made)
    for name in ("all", *GROUPS):
        these = [one for one in own if name in ("all", one.group)]
        rows.append(Row.info(name, "counted", len(these), "", spread=5.0))
        cleared = Share(sum(one.cleared for one in these), len(these))
        for what, share, least in (
            ("first grasp", first(these), FIRST),
            ("three grasps", cleared, ANY),
        ):
            quantity, (low, high) = f"in the bin, {what}", share.bounds
            rows += [
                Row.at_least(name, quantity, least, share.value, "", spread=0.02)
                if name == "all"
                else Row.info(name, quantity, share.value, "", spread=0.04),
                Row.info(name, f"{quantity}, at least", low, "", spread=0.04),
                Row.info(name, f"{quantity}, at most", high, "", spread=0.04),
            ]
    times = np.array([one.pick_time for one in own])
    rate = 3600.0 / float(np.nanmedian(times)) if np.isfinite(times).any() else 0.0
    rows.append(Row.at_least("all", "picks per hour, median", RATE, rate, "1/h"))
    rows += [
        Row.info("not in the bin", reason, count, "things", spread=2.0 + 0.3 * count)
        for reason, count in sorted(
            Counter(one.outcome for one in own if not one.cleared).items()
        )
    ]
    false = sum(one.claimed and not one.cleared for one in made)
    rows.append(Row.at_most("all", "claimed, not in the bin", 0.0, false, "things"))
    time = float(np.median([one.time for one in made]))
    rows.append(
        Row.at_most(
            "all", "processor time of a trial", MOST_TIME, time, "s", clock="time"
        )
    )
    return rows


def columns(made: Sequence[Single]) -> dict[str, list[Any]]:
    """Return a line of the table for each trial."""
    names = {"width": "width [m]", "pick_time": "pick [s]", "time": "processor [s]"}
    return {
        names.get(field.name, field.name): [getattr(one, field.name) for one in made]
        for field in dc.fields(Single)
    }


def draw(made: Sequence[Single]) -> Any:
    """Draw, for each kind, how many were in the bin, and after how many grasps."""
    own = graspable(made)
    kinds = sorted({(GROUPS.index(one.group), one.kind) for one in own})
    figure = make_figure(9.0, 1.4 + 0.2 * len(kinds), "Single things, one at a time")
    axes = figure.subplots()
    style_axes(axes, xlabel="share in the bin: first grasp, later, never")
    for y, (group, kind) in enumerate(reversed(kinds)):
        of_kind = [
            one for one in own if one.kind == kind and one.group == GROUPS[group]
        ]
        once, share = first(of_kind).value, np.mean([one.cleared for one in of_kind])
        axes.barh(y, once, color=COLORS[group], height=0.7)
        axes.barh(
            y, share - once, left=once, color=COLORS[group], height=0.7, alpha=0.4
        )
        axes.text(1.01, y, f"{len(of_kind)}", fontsize=7, va="center")
    labels = [kind.replace("_", " ") for _, kind in reversed(kinds)]
    axes.set_yticks(range(len(kinds)), labels, fontsize=7)
    axes.set_xlim(0.0, 1.05)
    return figure
