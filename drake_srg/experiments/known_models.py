"""Known objects of any form, picked by the planner of `kitchen` and set down as before.

The object stands or lies as it is modelled, anywhere in the pick region and at a random
yaw. The planner knows its convex pieces and colours, and sees it with the ceiling
camera.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping

from drake_srg.experiments.kept_trials import KeptTrials
from drake_srg.experiments.known_shapes import (
    SCENARIO,
    YAW,
    Trial,
    columns,
    draw,
    judge,
)
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.table_trials import run_trial
from drake_srg.simulation.metrics import Metrics

# Each object's model, and the hue, saturation and value of what is seen of it.
MODELS: Mapping[str, tuple[str, str]] = {
    "mug": ("mug", "{lower: [193, 0.39, 0.06], upper: [217, 0.97, 1]}"),
    "squeeze bottle": (
        "squeeze_bottle",
        "{lower: [34, 0.54, 0.09], upper: [58, 1, 1]}",
    ),
    "meat can": (
        "010_potted_meat_can",
        "{lower: [209, 0.45, 0.06], upper: [233, 1, 1]}",
    ),
    "hammer": ("048_hammer", "{lower: [21, 0.28, 0.08], upper: [45, 0.71, 1]}"),
}


def run(
    track: Track, *, trials: int = 6, seed: int = 945_000, keep: str = ""
) -> ExperimentResult:
    """Pick and place every object.

    Args:
        track: Shows progress.
        trials: Of each object.
        seed: Of the first trial.
        keep: File of finished trials, with which a run that was cut off goes on.
    """
    kept = KeptTrials(keep)
    runs: dict[str, dict[int, Metrics]] = {case: {} for case in MODELS}
    for trial in track([Trial(c, seed + i) for i in range(trials) for c in runs]):
        made = functools.partial(
            run_trial, SCENARIO, overrides_of(trial.case), trial.seed
        )
        runs[trial.case][trial.seed] = Metrics(**kept(str(trial), made))
    figure = draw(runs, "Known objects, picked and placed")
    return ExperimentResult(judge(runs), {"trials": columns(runs)}, figure)


def overrides_of(case: str) -> tuple[str, ...]:
    """Return what makes one of `MODELS` the object that the scenario picks."""
    model, colors = MODELS[case]
    return (
        f"object.model=package://drake_srg/sdf/{model}.sdf",
        f"object.color_range={colors}",
        YAW,
    )
