"""Cost of recording a trial of a sweep, part by part, relative to an unrecorded one.

The cost is processor time of all threads in a worker of a sweep, with one thread each
for rendering and linear algebra. It varies by a tenth between equal runs.
"""

from __future__ import annotations

import dataclasses as dc
import tempfile
import time as wall
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.lifetime import free_diagrams
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.sweeps.engines import JoblibEngine
from drake_srg.types import Vector

SCENARIOS = ("kitchen_varied", "assistive_arm_varied")
SEEDS = range(3)
_NO_VIDEO, _NO_IMAGES = "recording.video_camera=''", "recording.bag_cameras=[]"
# What is recorded, and the overrides for it; None records nothing.
PARTS: dict[str, tuple[str, ...] | None] = {
    "unrecorded": None,
    "numbers alone": (_NO_VIDEO, _NO_IMAGES),
    "video, no images": (_NO_IMAGES,),
    "images, no video": (_NO_VIDEO,),
    "images, and the same as video": ("recording.video_camera=ceiling",),
    "everything": (),
    "everything, video of 1280 x 720": (
        "cameras.overview.width=1280",
        "cameras.overview.height=720",
    ),
}
# Recording everything must take no longer than three unrecorded trials.
_MOST = 3.0
_RENDERING = "images take most of it"
# Two costs that each vary by a tenth have a ratio that varies by twice that, relative.
_SPREAD = 0.2


@dc.dataclass(frozen=True)
class Case:
    """A trial and the part of it that is recorded."""

    scenario: str
    part: str
    seed: int

    def __str__(self) -> str:
        return f"{self.scenario}, {self.part}"


def processor_time(case: Case) -> float:
    """Run a trial and return its processor time, build included [s]."""
    overrides = PARTS[case.part]
    start = wall.process_time()
    scenario = load_scenario(case.scenario, seed=case.seed, overrides=overrides or ())
    with tempfile.TemporaryDirectory() as folder:
        out = None if overrides is None else Path(folder)
        Simulate(
            scenario,
            name=case.scenario,
            out=out,
            record=out is not None,
            video_process=False,  # as in a sweep
        )
    elapsed = wall.process_time() - start
    free_diagrams()  # as a sweep does after each trial
    return elapsed


def run(track: Track) -> ExperimentResult:
    """Run the same trials with each part recorded."""
    cases = [Case(n, p, s) for n in SCENARIOS for s in SEEDS for p in PARTS]
    with JoblibEngine(1) as engine:
        # Imports happen once in a process and belong to no trial.
        for name in SCENARIOS:
            engine.submit(processor_time, Case(name, "everything", SEEDS[0])).result()
        times = {c: engine.submit(processor_time, c).result() for c in track(cases)}
    costs = {
        name: {
            part: np.array([times[Case(name, part, s)] for s in SEEDS])
            for part in PARTS
        }
        for name in SCENARIOS
    }
    tables: dict[str, dict[str, Any]] = {
        name: {"seed": list(SEEDS), **{f"{part} [s]": c for part, c in cost.items()}}
        for name, cost in costs.items()
    }
    return ExperimentResult(judge(costs), tables, draw(costs))


def ratios(cost: Mapping[str, Vector]) -> dict[str, float]:
    """Return the median ratio of each part to the same seeds unrecorded."""
    return {part: float(np.median(c / cost["unrecorded"])) for part, c in cost.items()}


def judge(costs: Mapping[str, Mapping[str, Vector]]) -> Sequence[Row]:
    """Judge the cost of recording everything; the parts show where it goes."""
    rows = []
    for name, cost in costs.items():
        median = float(np.median(cost["unrecorded"]))
        rows.append(Row.info(name, "unrecorded", median, "s", clock="time"))
        for part, ratio in ratios(cost).items():
            unit, spread = "x unrecorded", _SPREAD * ratio
            if part == "everything":
                row = Row.at_most(name, part, _MOST, ratio, unit, spread=spread)
                rows.append(row.because(_RENDERING))
            elif part != "unrecorded":
                rows.append(Row.info(name, part, ratio, unit, spread=spread))
    return rows


def draw(costs: Mapping[str, Mapping[str, Vector]]) -> Any:
    """Draw the ratios as bars, with a colour for each scenario."""
    figure = make_figure(8.0, 3.2, "Cost of recording a trial")
    axes = figure.add_subplot()
    style_axes(axes, xlabel="processor time relative to the same trial, unrecorded")
    places = np.arange(len(PARTS))
    for i, (name, cost) in enumerate(costs.items()):
        values = list(ratios(cost).values())
        bars = axes.barh(
            places + 0.4 * i - 0.2, values, 0.38, color=COLORS[i], label=name
        )
        axes.bar_label(bars, fmt="%.1f", fontsize=8, padding=3)
    axes.set_yticks(places, PARTS, fontsize=8)
    axes.invert_yaxis()
    axes.legend(fontsize=8, frameon=False, loc="upper right")
    return figure
