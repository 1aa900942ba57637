"""Sweeps with one worker and with two: trials per second and memory over 200 trials.

The wall clock covers the whole sweep, including checks and the start of the workers,
with one thread for each worker. It is meaningful only on an otherwise idle machine with
at least two cores.
"""

from __future__ import annotations

import dataclasses as dc
import tempfile
import time as wall
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.sweeps.engines import JoblibEngine
from drake_srg.sweeps.sweep import run_sweep
from drake_srg.types import Vector

SCENARIO, TRIALS = "kitchen_varied", 200
# Least speed of two workers over one, and greatest memory of a worker [MB].
_RATIO, _MEMORY = 1.9, 600.0
# Trials after which a worker has loaded everything. Its growth is judged from there.
_WARM = 20
# Greatest growth of a worker's memory [MB per trial]: from 410 MB, when it is warm, it
# must stay below _MEMORY for a thousand trials. Steps of 17 MB, which come and go, are
# slopes of at most 1.5 * 17 / n over n trials: 0.14 over the 180 trials of a single
# worker, but 0.32 over the 80 of each of two, whose growth is therefore not judged.
_GROWTH, _STEP = (_MEMORY - 410.0) / 1000, 17.0


@dc.dataclass(frozen=True)
class Sweep:
    """The time and memory of a sweep.

    Attributes:
        jobs: Number of workers.
        wall: Wall clock [s].
        memory: Resident memory after each trial [MB], by worker.
    """

    jobs: int
    wall: float
    memory: dict[str, Vector]


def run(track: Track) -> ExperimentResult:
    """Run the same trials with one worker and with two."""
    sweeps = [measure(jobs, TRIALS) for jobs in track((1, 2), "{} at a time".format)]
    table = {
        "jobs": [s.jobs for s in sweeps for m in s.memory.values() for _ in m],
        "worker": [
            i for s in sweeps for i, m in enumerate(s.memory.values()) for _ in m
        ],
        "memory [MB]": [x for s in sweeps for m in s.memory.values() for x in m],
    }
    return ExperimentResult(judge(sweeps), {"memory": table}, draw(sweeps))


def measure(jobs: int, trials: int, scenario: str = SCENARIO) -> Sweep:
    """Run a sweep into a temporary folder."""
    with tempfile.TemporaryDirectory() as folder:
        start = wall.perf_counter()
        rows = run_sweep(scenario, trials, out=Path(folder), engine=JoblibEngine(jobs))
        elapsed = wall.perf_counter() - start
    worker = np.array(rows["worker"].to_pylist())
    memory = np.array(rows["memory_mb"].to_pylist(), dtype=float)
    return Sweep(jobs, elapsed, {w: memory[worker == w] for w in np.unique(worker)})


def judge(sweeps: Sequence[Sweep]) -> list[Row]:
    """Expect two workers to be nearly twice as fast, and memory not to grow."""
    one, two = sweeps
    rows = [
        Row.info(f"{s.jobs} at a time", "wall clock", s.wall, "s", clock="time")
        for s in sweeps
    ]
    rows.append(Row.at_least("2 : 1", "throughput", _RATIO, one.wall / two.wall, ""))
    for sweep in sweeps:
        name = f"{sweep.jobs} at a time"
        for memory in sweep.memory.values():
            largest, slope = float(memory.max()), growth(memory)
            what, step = "growth a trial", 1.5 * _STEP / len(warm(memory))
            rows += [
                Row.at_most(name, "largest memory of a worker", _MEMORY, largest, "MB"),
                Row.at_most(name, what, _GROWTH, slope, "MB", spread=step)
                if sweep is one
                else Row.info(name, what, slope, "MB", spread=step),
            ]
    return rows


def warm(memory: Vector) -> Vector:
    """Return a worker's memory after the trials in which it loads everything [MB]."""
    return memory[min(_WARM, len(memory) // 2) :]


def growth(memory: Vector) -> float:
    """Return the slope of a worker's memory over its trials [MB per trial]."""
    later = warm(memory)
    return float(np.polyfit(np.arange(len(later)), later, 1)[0])


def draw(sweeps: Sequence[Sweep]) -> Any:
    """Draw each worker's memory over its trials."""
    figure = make_figure(7.0, 3.0, "Memory of each worker")
    axes = figure.add_subplot()
    style_axes(axes, xlabel="trials of a worker", ylabel="resident memory [MB]")
    for color, sweep in zip(COLORS, sweeps, strict=False):
        for i, memory in enumerate(sweep.memory.values()):
            label = f"{sweep.jobs} at a time" if i == 0 else None
            axes.plot(np.arange(1, len(memory) + 1), memory, color=color, label=label)
    axes.axhline(_MEMORY, color="0.6", linestyle="--", label="limit")
    axes.set_ylim(0.0, None)
    axes.legend(frameon=False, fontsize=8, loc="lower right")
    return figure
