"""The five-axis arm's task by our planner over a bus of emulated servos.

Joints and gripper are commanded and measured by packets of the Dynamixel protocols
alone: the planner has no distance sensors, and joints in counts of 0.088 degrees.
Pictures come straight from the simulated camera. Both sides advance in turn, so no
result depends on the machine's speed.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.experiments.cycles import run_cycle
from drake_srg.experiments.kept_trials import KeptTrials
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.servo_runs import Wire, run_over_servos
from drake_srg.recording.timeline import make_figure, style_axes

_SCENARIO = "assistive_arm"
_WITHOUT = "without a bus"
WIRES: Mapping[str, Wire] = {
    "Protocol 1.0": Wire(),
    "Protocol 2.0": Wire(protocol=2),
    "20 ms each way": Wire(latency=0.02),
    "5 % damaged": Wire(loss=0.05),
    "servo reboots": Wire(reboot=3.0),
    "reboot, 0.2 s silent": Wire(reboot=3.0, silence=0.2),
}
_CLEAN = ("Protocol 1.0", "Protocol 2.0")
# Placement may be off by this many times what it is without a bus, besides what whole
# counts of the joints make of it.
_FACTOR = 2.0


def run(
    track: Track, *, seeds: int = 20, fault_seeds: int = 20, keep: str = ""
) -> ExperimentResult:
    """Do the task over every kind of wire, and without a bus.

    Args:
        track: Shows progress.
        seeds: Number of runs over each protocol, and without a bus.
        fault_seeds: Number of runs with each fault.
        keep: File with the trials of an earlier run, which are not repeated; new ones
            are added.
    """
    kept = KeptTrials(keep)
    count = {name: seeds if name in _CLEAN else fault_seeds for name in WIRES}
    cases = [(_WITHOUT, seed) for seed in range(seeds)]
    cases += [(name, seed) for name, most in count.items() for seed in range(most)]
    runs: dict[str, list[Mapping[str, Any]]] = {}
    for name, seed in track(cases, lambda case: f"{case[0]}, seed {case[1]}"):
        trial = kept(f"{name}, {seed}", functools.partial(_trial, name, seed))
        runs.setdefault(name, []).append(trial)
    rows = [row for name, trials in runs.items() for row in judge(name, trials, runs)]
    lines = [
        {"wire": name, "seed": seed, **trial}
        for name, trials in runs.items()
        for seed, trial in enumerate(trials)
    ]
    table = {column: [line[column] for line in lines] for column in lines[0]}
    return ExperimentResult(rows, {"runs": table}, draw(runs))


def _trial(name: str, seed: int) -> Mapping[str, Any]:
    """Return the outcome of a run as numbers and text."""
    if name == _WITHOUT:
        metrics = run_cycle(_SCENARIO, seed).metrics
        x, y, _ = metrics.placement_error_m or (np.nan,) * 3
        return {
            "claimed": int(metrics.failure is None),
            "placed": int(bool(metrics.success)),
            "reason": metrics.failure or "",
            "error": float(max(abs(x), abs(y))),
            "rounding": 0.0,
        }
    outcome = run_over_servos(_SCENARIO, seed, WIRES[name])
    return {
        "claimed": int(outcome.claimed),
        "placed": int(outcome.placed),
        "reason": outcome.stopped or outcome.reason,
        "error": outcome.error,
        "rounding": outcome.rounding,
    }


def judge(
    name: str,
    trials: Sequence[Mapping[str, Any]],
    runs: Mapping[str, Sequence[Mapping[str, Any]]],
) -> list[Row]:
    """Judge the runs over a wire by those without a bus.

    Args:
        name: Of the wire.
        trials: Its runs.
        runs: All runs, by wire.
    """
    placed = sum(trial["placed"] for trial in trials)
    errors = [trial["error"] for trial in trials if trial["placed"]]
    worst = 1e3 * max(errors, default=np.nan)
    what, unit = "largest placement error in x or y", "mm"
    if name == _WITHOUT:
        return [
            Row.info(name, f"placed, of {len(trials)}", placed, ""),
            Row.info(name, what, worst, unit),
        ]
    wrong = sum(t["claimed"] and not t["placed"] for t in trials)
    silent = sum(not t["placed"] and not t["reason"] for t in trials)
    counts = 1e3 * max((t["rounding"] for t in trials if t["placed"]), default=np.nan)
    limit = _FACTOR * 1e3 * max(t["error"] for t in runs[_WITHOUT])
    rows = [
        Row.at_most(name, "claimed, but not placed", 0, wrong, ""),
        Row.at_most(name, "neither placed nor told why", 0, silent, ""),
    ]
    if errors or name in _CLEAN:
        rows.append(Row.at_most(name, what, limit + counts, worst, unit))
    if errors:
        part = "of the limit, half a count of each joint"
        rows.append(Row.info(name, part, counts, unit))
    if name in _CLEAN:
        rows.append(
            Row.at_least(name, f"placed, of {len(trials)}", len(trials), placed, "")
        )
    else:
        rows.append(Row.info(name, f"placed, of {len(trials)}", placed, ""))
    return rows


def draw(runs: Mapping[str, Sequence[Mapping[str, Any]]]) -> Any:
    """Return a figure of the placement errors of each wire."""
    figure = make_figure(8.0, 3.6, "The five-axis arm's task over a servo bus")
    axes = figure.add_subplot()
    style_axes(axes, ylabel="placement error, larger of x and y [mm]")
    for k, trials in enumerate(runs.values()):
        errors = [1e3 * t["error"] for t in trials if t["placed"]]
        across = np.linspace(k - 0.2, k + 0.2, len(errors))
        axes.plot(across, errors, "o", ms=4)
    labels = [
        f"{name}\n{sum(t['placed'] for t in trials)} of {len(trials)}"
        for name, trials in runs.items()
    ]
    axes.set_xticks(range(len(runs)), labels, fontsize=7)
    axes.set_ylim(0.0, None)
    return figure
