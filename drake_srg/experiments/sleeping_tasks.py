"""Whether objects that sleep change how a task ends.

The varied kitchen, its arm and hand discrete, with a can and two pieces of clutter on
the table that brings things to rest. Each trial is simulated with all objects awake and
with objects that sleep, and must end the same in words: success, the reason of a
failure, the number of attempts. That limit was set before the first run.
"""

from __future__ import annotations

import dataclasses as dc
import time as wall
from collections.abc import Mapping
from typing import Any

import numpy as np

from drake_srg.common.log_format import is_pose
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.sleeping import ASLEEP, AWAKE, MOVED
from drake_srg.experiments.whole_run import simulate_whole
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.scenario import load_scenario
from drake_srg.sweeps.statistics import wilson_interval
from drake_srg.types import Vector

SCENARIO = "kitchen_varied_accurate"
_OVERRIDES = (
    # Contact settings in which things rest; see `resting`. Then, what saves time.
    "plant_config.time_step=0.005",
    "plant_config.stiction_tolerance=1.0e-3",
    "directives.table.add_model.file=package://drake_srg/sdf/table_mat.sdf",
    "directives.gripper.add_model.file=package://drake_srg/sdf/srg_fast.sdf",
    "ignored_contacts=[['arm::*', 'arm::*'], ['arm::*', 'gripper::*']]",
    "clutter.count=2",
)
_KINDS: Mapping[str, tuple[str, ...]] = {AWAKE: (), ASLEEP: ("sleeping={}",)}


@dc.dataclass(frozen=True)
class Trial:
    """How a trial ends.

    Attributes:
        success: Whether the task succeeded.
        failure: Why not, or "".
        attempts: Grasps begun.
        touched: Whether anything but the can moved by more than 5 mm.
        ends: Last positions of the objects, shape (N, 3) [m].
        seconds: Processor time, building included [s].
    """

    success: bool
    failure: str
    attempts: int
    touched: bool
    ends: Vector
    seconds: float

    @property
    def outcome(self) -> tuple[bool, str, int]:
        """What must not differ."""
        return self.success, self.failure, self.attempts


# Trials by the kind of simulation, one for each seed.
Trials = Mapping[str, list[Trial]]


def run(track: Track, *, trials: int = 300, seed: int = 0) -> ExperimentResult:
    """Simulate each trial awake and asleep.

    Args:
        track: Shows progress.
        trials: Number of trials.
        seed: Of the first trial.
    """
    made: Trials = {kind: [] for kind in _KINDS}
    seeds = range(seed, seed + trials)
    for number in track(seeds, lambda number: f"seed {number}"):
        for kind, found in made.items():
            found.append(simulate(number, kind))
    table = columns(list(seeds), made)
    return ExperimentResult(judge(made), {"trials": table}, draw(made))


def simulate(seed: int, kind: str) -> Trial:
    """Simulate a trial, `AWAKE` or `ASLEEP`."""
    start = wall.process_time()
    overrides = (*_OVERRIDES, *_KINDS[kind])
    result = simulate_whole(load_scenario(SCENARIO, seed=seed, overrides=overrides))
    m = result.metrics
    poses = [log for key, log in result.log.items() if is_pose(key)]
    return Trial(
        m.success,
        m.failure or "",
        m.attempts,
        (m.others_moved_m or 0.0) > MOVED,
        np.array([log[-1, :3] for log in poses]),
        wall.process_time() - start,
    )


def distances(made: Trials) -> Vector:
    """Return how far apart the ends of each trial are, at most [m]."""
    pairs = zip(made[AWAKE], made[ASLEEP], strict=True)
    return np.array([np.linalg.norm(a.ends - b.ends, axis=1).max() for a, b in pairs])


def judge(made: Trials) -> list[Row]:
    """Expect the same outcome of every trial."""
    awake, asleep = made[AWAKE], made[ASLEEP]
    count, pairs = len(awake), list(zip(awake, asleep, strict=True))
    other = sum(a.outcome != b.outcome for a, b in pairs)
    low, high = wilson_interval(other, count)
    both, of = "awake and asleep", f"of {count}"
    rows = [
        Row.at_most(both, "trials that end otherwise", 0.0, other, of),
        Row.info(both, "their share, at least", low, "", spread=0.01),
        Row.info(both, "their share, at most", high, "", spread=0.01),
    ]
    for kind, found in made.items():
        for quantity, number in (
            ("successes", sum(t.success for t in found)),
            ("trials of several attempts", sum(t.attempts > 1 for t in found)),
            ("trials that move another object", sum(t.touched for t in found)),
        ):
            rows.append(Row.info(kind, quantity, number, of, spread=3.0))
    moved = sum(a.touched != b.touched for a, b in pairs)
    quantity = "trials in which only one moves another object"
    rows.append(Row.info(both, quantity, moved, of, spread=3.0))
    for share, word in ((0.5, "median"), (0.95, "95th percentile"), (1.0, "largest")):
        apart = 1e3 * float(np.quantile(distances(made), share))
        quantity = f"difference of positions, {word}"
        rows.append(Row.info(both, quantity, apart, "mm", spread=apart))
    cost = sum(t.seconds for t in asleep) / sum(t.seconds for t in awake)
    rows.append(Row.info(both, "cost asleep over cost awake", cost, "", spread=0.1))
    return rows


def columns(seeds: list[int], made: Trials) -> dict[str, list[Any]]:
    """Return a line of the table for each trial and simulation."""
    table: dict[str, list[Any]] = {}
    apart = distances(made)
    for i, seed in enumerate(seeds):
        for kind, found in made.items():
            for column, value in (
                ("seed", seed),
                ("simulated", kind),
                ("success", int(found[i].success)),
                ("failure", found[i].failure),
                ("attempts", found[i].attempts),
                ("moves another", int(found[i].touched)),
                ("difference [mm]", 1e3 * float(apart[i])),
                ("processor time [s]", found[i].seconds),
            ):
                table.setdefault(column, []).append(value)
    return table


def draw(made: Trials) -> Any:
    """Draw how far apart the ends are, for trials that end alike and otherwise."""
    figure = make_figure(7.0, 3.2, "Tasks with objects that sleep")
    axes = figure.subplots()
    style_axes(
        axes, xlabel="largest difference of a position [mm]", ylabel="trials [%]"
    )
    apart = 1e3 * np.maximum(distances(made), 1e-8)
    order = np.argsort(apart)
    share = 100.0 * (np.arange(len(apart)) + 1) / len(apart)
    axes.step(apart[order], share, color=COLORS[0], where="post", label="all trials")
    pairs = list(zip(made[AWAKE], made[ASLEEP], strict=True))
    other = np.array([a.outcome != b.outcome for a, b in pairs])[order]
    label = "trials that end otherwise"
    axes.plot(apart[order][other], share[other], "o", color=COLORS[1], label=label)
    axes.set_xscale("log")
    axes.legend(fontsize=8, frameon=False)
    return figure
