"""Sweeps with one worker and with two: trials a second, and memory over 200 trials.

Wall clock is that of the whole sweep, checks and start of the workers included, with
one thread a worker both times. It means something on a machine with two cores or more
that does nothing else.
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
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.recording.figure import COLORS, make_figure, style_axes
from drake_srg.sweeps.engines import JoblibEngine
from drake_srg.sweeps.sweep import run_sweep
from drake_srg.types import Vector

SCENARIO, TRIALS = "kitchen_varied", 200
# What is asked of two workers, and of a worker's memory [MB].
_RATIO, _MEMORY = 1.9, 600.0
# Trials after which a worker has seen everything once; its memory is judged from there.
_WARM = 20
_LONG = 1000  # trials that the memory must suffice for, by its slope


@dc.dataclass(frozen=True)
class Sweep:
    """What a sweep took."""

    jobs: int
    wall: float  # s
    memory: dict[str, Vector]  # resident after each trial, a worker [MB]


def run(track: Track) -> ExperimentResult:
    """Run the same trials by one worker and by two."""
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
    """Run a sweep into a folder that does not stay."""
    with tempfile.TemporaryDirectory() as folder:
        start = wall.perf_counter()
        rows = run_sweep(scenario, trials, out=Path(folder), engine=JoblibEngine(jobs))
        elapsed = wall.perf_counter() - start
    worker = np.array(rows["worker"].to_pylist())
    memory = np.array(rows["memory_mb"].to_pylist(), dtype=float)
    return Sweep(jobs, elapsed, {w: memory[worker == w] for w in np.unique(worker)})


def judge(sweeps: Sequence[Sweep]) -> list[Row]:
    """Expect two to be nearly twice as fast, and memory to stay."""
    one, two = sweeps
    rows = [Row.info(f"{s.jobs} at a time", "wall clock", s.wall, "s") for s in sweeps]
    rows.append(Row.at_least("2 : 1", "throughput", _RATIO, one.wall / two.wall, ""))
    for sweep in sweeps:
        for memory in sweep.memory.values():
            name = f"{sweep.jobs} at a time"
            largest, later = float(memory.max()), extrapolate(memory)
            rows += [
                Row.at_most(name, "largest memory of a worker", _MEMORY, largest, "MB"),
                Row.at_most(name, f"after {_LONG} trials", _MEMORY, later, "MB"),
            ]
    return rows


def extrapolate(memory: Vector) -> float:
    """Return a worker's memory after many trials, by a line through what was seen."""
    trials = np.arange(len(memory))
    warm = slice(min(_WARM, len(memory) // 2), None)
    slope, offset = np.polyfit(trials[warm], memory[warm], 1)
    return float(offset + slope * _LONG)


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
