"""The five-axis arm before its modification: fingertips or tip frame, which mended it?

The thesis of the five-axis arm began with flat, hard, smooth fingertips and a tip frame
as drawn, and reports frequent failures and a constant offset. With curved fingertips
and the tip frame moved, it reports ten of ten grasps. Here, the cylinder stands
anywhere in the pick region, and the arm takes it by the thesis's rules, with every
combination of flat or curved pads, hard plastic or rubber, friction between pad and
cylinder, and tip as drawn or corrected.

P3 and P4 are taught with either tip: they take it to the same places.
"""

from __future__ import annotations

import dataclasses as dc
import itertools
import json
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drake_srg.experiments.cycles import Cycle, run_cycle
from drake_srg.experiments.linkage_pads import MATERIALS, MODELS, Pads, write_model
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.experiments.trials import (
    LIFTED,
    PLACED,
    bounds,
    line,
    outcomes,
    share_rows,
)
from drake_srg.recording.figure import COLORS, make_figure, style_axes
from drake_srg.scenario import load_scenario
from drake_srg.scenario.load import load_tree
from drake_srg.types import Vector

SCENARIO = "assistive_arm_fast"
AS_DRAWN, CORRECTED = "tip as drawn", "tip corrected"
# The scenario that has the waypoints taught with each tip.
TIPS = {AS_DRAWN: "assistive_arm_before", CORRECTED: "assistive_arm_thesis"}
FRICTION = (0.1, 0.2, 0.3, 0.4, 0.6, 0.8)
# The cylinder's own friction, the middle of the scenario's range, and its modulus, the
# package's default for objects: much stiffer than rubber, so that the pads' hardness
# counts.
_OBJECT_FRICTION = 0.65
_OBJECT = (f"object.friction={_OBJECT_FRICTION}", "object.modulus=5.0e+7")
# The thesis's motions and waits until it has let the cylinder go.
_RULES = ("tip_limits", "grip_wait", "release_wait")
_QUICK = 2  # trials of a quick run


@dc.dataclass(frozen=True)
class Case:
    """Fingertips and tip frame."""

    pads: Pads
    tip: str

    @property
    def group(self) -> tuple[str, str, str]:
        """Everything but the friction."""
        return self.pads.shape, self.pads.material, self.tip

    def __str__(self) -> str:
        return f"{self.pads}, {self.tip}"


_Runs = Mapping[Case, Sequence[Cycle]]


def run(track: Track, *, trials: int = 10, quick: bool = False) -> ExperimentResult:
    """Grasp, carry and place the cylinder with every combination.

    Args:
        track: Shows progress.
        trials: Number of trials of each combination, a seed each.
        quick: Whether to run 2 trials only.
    """
    seeds = range(_QUICK if quick else trials)
    runs: dict[Case, list[Cycle]] = {case: [] for case in all_cases()}
    cases = list(itertools.product(runs, seeds))
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / "linkage_gripper.sdf"
        for case, seed in track(cases, lambda case: f"{case[0]}, seed {case[1]}"):
            if not runs[case]:
                write_model(case.pads, _OBJECT_FRICTION, model)
            runs[case].append(run_cycle(SCENARIO, seed, overrides(case, seed, model)))
    lines = [
        {**dc.asdict(case.pads), "tip": case.tip, **line(cycle)}
        for case, cycles in runs.items()
        for cycle in cycles
    ]
    table = {name: [line[name] for line in lines] for name in lines[0]}
    return ExperimentResult(judge(runs), {"trials": table}, draw(runs))


def all_cases() -> list[Case]:
    """Return every combination, those of a group beside each other."""
    return [
        Case(Pads(shape, material, friction), tip)
        for tip, shape, material, friction in itertools.product(
            TIPS, MODELS, MATERIALS, FRICTION
        )
    ]


def overrides(case: Case, seed: int, model: Path) -> list[str]:
    """Return a trial as overrides of `SCENARIO`.

    The camera hangs straight above the cylinder. There, the thesis's rule errs in the
    plane as little as the thesis prints (0.07 mm), and not by the 2 mm that the rule
    makes with our camera, which hangs between the tables.

    Args:
        case: The case.
        seed: Of the trial; draws the cylinder's place.
        model: The gripper's SDF.
    """
    tree = load_tree(TIPS[case.tip])
    place = load_scenario(SCENARIO, seed=seed).objects["cylinder"].position
    assert place is not None  # drawn
    camera = tree["cameras"]["ceiling"]
    height = camera["X_PB"]["translation"][2]
    rules = {
        "arm.home": tree["arm"]["home"],
        "cameras.ceiling": camera,
        "cameras.ceiling.X_PB.translation": [*place, height],
        "localizer": tree["localizer"],
        "taught": tree["taught"],
        **{f"planner.{key}": tree["planner"][key] for key in _RULES},
        # A multiple of 1/1024 s, as this integrator needs it.
        "localizer.thesis.period": 0.046875,
        "directives.gripper.add_model.file": model.as_uri(),
    }
    if case.tip == AS_DRAWN:
        (tip,) = (d for d in tree["directives"] if "add_directives" in d)
        rules["directives.assistive_arm_fast_tip"] = tip
    return [*_OBJECT, *(f"{key}={json.dumps(value)}" for key, value in rules.items())]


# The four steps from the thesis's beginning to its end: pads and tip.
STEPS: Mapping[str, tuple[str, str, str]] = {
    "before": ("flat", "hard", AS_DRAWN),
    "fingertips alone": ("curved", "rubber", AS_DRAWN),
    "tip alone": ("flat", "hard", CORRECTED),
    "both": ("curved", "rubber", CORRECTED),
}


def by_group(runs: _Runs) -> dict[tuple[str, str, str], list[Cycle]]:
    """Return the trials by shape, material and tip, of all frictions."""
    groups: dict[tuple[str, str, str], list[Cycle]] = {}
    for case, cycles in runs.items():
        groups.setdefault(case.group, []).extend(cycles)
    return groups


def offsets(cycles: Iterable[Cycle]) -> Vector:
    """Return the placement errors in the palm's x and y, shape (K, 2) [mm].

    Those of cylinders that were lifted and released, placed or not.
    """
    errors = [
        1e3 * c.error_G[:2]
        for c in cycles
        if c.error_G is not None and c.metrics.grasp_lifted
    ]
    return np.reshape(errors, (-1, 2))


def judge(runs: _Runs) -> list[Row]:
    """State shares and offsets; expect both modifications to mend it beyond doubt."""
    rows, groups = [], by_group(runs)
    for group, cycles in groups.items():
        name = ", ".join(group)
        rows += share_rows(name, cycles)
        for axis, values in zip("xy", offsets(cycles).T, strict=True):
            if len(values):
                quantity = f"offset along the palm's {axis}"
                mean, spread = float(np.mean(values)), float(np.std(values))
                rows += [
                    Row.info(name, f"{quantity}, mean", mean, "mm", spread=0.1),
                    Row.info(name, f"{quantity}, deviation", spread, "mm", spread=0.1),
                ]
    for case, cycles in runs.items():
        for what, done in outcomes(cycles).items():
            share = float(np.mean(done))
            rows.append(Row.info(str(case), f"{what}, share", share, "", spread=0.2))
    (_, most), (least, _) = (bounds(groups[STEPS[step]]) for step in ("before", "both"))
    quantity = "placed: least share; expected: most before"
    rows.append(Row.at_least("both", quantity, most, least, "", spread=0.05))
    return rows


def draw(runs: _Runs) -> Any:
    """Draw the shares by friction, and where the cylinders end."""
    count = len(next(iter(runs.values())))
    title = f"Fingertips or tip frame: {count} trials of each combination"
    figure = make_figure(11.0, 4.6, title)
    *shares, errors = figure.subplots(1, 3)
    for axes, tip in zip(shares, TIPS, strict=True):
        style_axes(axes, xlabel="friction between pad and cylinder")
        axes.set_title(tip, fontsize=9, loc="left")
        axes.set_ylim(-0.03, 1.03)
        pads = list(itertools.product(MODELS, MATERIALS))
        for k, ((shape, material), color) in enumerate(zip(pads, COLORS, strict=False)):
            at = np.array(FRICTION) + 0.008 * (k - 1.5)
            cycles = [runs[Case(Pads(shape, material, f), tip)] for f in FRICTION]
            placed = np.array([np.mean(outcomes(c)[PLACED]) for c in cycles])
            lifted = [np.mean(outcomes(c)[LIFTED]) for c in cycles]
            low, high = np.transpose([bounds(c) for c in cycles])
            around = [placed - low, high - placed]
            axes.errorbar(
                at,
                placed,
                around,
                color=color,
                marker="o",
                ms=4,
                lw=1.0,
                label=f"{shape}, {material}" if tip == AS_DRAWN else None,
            )
            axes.plot(at, lifted, ":", color=color, lw=1.0)
    shares[0].set_ylabel(
        "placed (dotted: lifted), share with 95 % interval", fontsize=9
    )
    style_axes(
        errors, xlabel="offset along the palm's x [mm]", ylabel="along its y [mm]"
    )
    groups = by_group(runs)
    for (step, group), color in zip(STEPS.items(), COLORS, strict=False):
        errors.plot(*offsets(groups[group]).T, "o", ms=3, color=color, label=step)
    circle = np.linspace(0.0, 2.0 * np.pi, 100)
    errors.plot(np.cos(circle), np.sin(circle), color=COLORS[-1], lw=0.8)
    errors.set_aspect("equal", adjustable="datalim")
    errors.legend(fontsize=8)
    figure.legend(loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return figure
