"""What mended the five-axis arm after its beginning: its fingertips or its tip frame.

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
import functools
import itertools
import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drake_srg.experiments.cycles import Cycle, run_cycle
from drake_srg.experiments.linkage_pads import MATERIALS, MODELS, Pads, write_model
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.trials import (
    PLACED,
    bounds,
    line,
    outcomes,
    quantile_rows,
    share_rows,
)
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.scenario import load_scenario
from drake_srg.scenario.load import load_tree
from drake_srg.types import Vector

SCENARIO = "assistive_arm_fast"
AS_DRAWN, CORRECTED = "as drawn", "corrected"
# The scenario that has the waypoints taught with each tip.
TIPS = {AS_DRAWN: "assistive_arm_before", CORRECTED: "assistive_arm_thesis"}
FRICTION = (0.1, 0.2, 0.3, 0.4, 0.6, 0.8)
# The cylinder's own friction, the middle of the scenario's range, and its modulus, the
# package's default for objects: much stiffer than rubber, so that the pads' hardness
# counts.
_OBJECT_FRICTION = 0.65
_OBJECT = (f"object.friction={_OBJECT_FRICTION}", "object.modulus=5.0e+7")
# The thesis's waypoints, motions and waits until it has let the cylinder go.
_RULES = ("lift", "place", "tip_limits", "grip_wait", "release_wait")
_QUICK = 1  # trial of each combination in a quick run


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
        return f"{self.pads}, tip {self.tip}"


_Runs = Mapping[Case, Sequence[Cycle]]


def run(track: Track, *, trials: int = 5, quick: bool = False) -> ExperimentResult:
    """Grasp, carry and place the cylinder with every combination.

    Args:
        track: Shows progress.
        trials: Number of trials of each combination, a seed each.
        quick: Whether to run 1 trial only.
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
    tree, place = _tree(case.tip), _place(seed)
    camera = tree["cameras"]["ceiling"]
    height = camera["X_PB"]["translation"][2]
    rules = {
        "arm.home": tree["arm"]["home"],
        "cameras.ceiling": camera,
        "cameras.ceiling.X_PB.translation": [*place, height],
        "localizer": tree["localizer"],
        "planner": {
            **load_tree(SCENARIO)["planner"],
            **{key: tree["planner"][key] for key in ("_tag", *_RULES)},
        },
        # A multiple of 1/1024 s, as this integrator needs it.
        "localizer.thesis.period": 0.046875,
        "directives.gripper.add_model.file": model.as_uri(),
    }
    if case.tip == AS_DRAWN:
        (tip,) = (d for d in tree["directives"] if "add_directives" in d)
        rules["directives.assistive_arm_fast_tip"] = tip
    return [*_OBJECT, *(f"{key}={json.dumps(value)}" for key, value in rules.items())]


@functools.cache
def _tree(tip: str) -> Mapping[str, Any]:
    """Return the scenario whose rules a tip follows."""
    return load_tree(TIPS[tip])


@functools.cache
def _place(seed: int) -> Sequence[float]:
    """Return where a trial's cylinder stands, shape (2,) [m]."""
    place = load_scenario(SCENARIO, seed=seed).objects["cylinder"].position
    assert place is not None  # drawn
    return place


def levels(runs: _Runs) -> dict[str, dict[str, list[Cycle]]]:
    """Return the trials at each level of each factor, whatever the other factors."""
    found: dict[str, dict[str, list[Cycle]]] = {}
    for case, cycles in runs.items():
        shape, material, tip = case.group
        for factor, level in (
            ("tip", tip),
            ("shape", shape),
            ("material", material),
            ("friction", f"{case.pads.friction:g}"),
        ):
            found.setdefault(factor, {}).setdefault(level, []).extend(cycles)
    return found


def by_group(runs: _Runs) -> dict[tuple[str, str, str], list[Cycle]]:
    """Return the trials by shape, material and tip, of all frictions."""
    groups: dict[tuple[str, str, str], list[Cycle]] = {}
    for case, cycles in runs.items():
        groups.setdefault(case.group, []).extend(cycles)
    return groups


def distances(cycles: Sequence[Cycle]) -> Vector:
    """Return how far from the goal cylinders end in the plane, shape (K,) [mm]."""
    errors = [c.metrics.placement_error_m for c in cycles]
    return np.array([1e3 * np.linalg.norm(e[:2]) for e in errors if e is not None])


def judge(runs: _Runs) -> list[Row]:
    """State shares and distances; expect the corrected tip to pay beyond doubt.

    Its interval lies above that of the tip as drawn, whatever the pads.
    """
    rows, factors = [], levels(runs)
    for factor, cycles_at in factors.items():
        for level, cycles in cycles_at.items():
            rows += share_rows(f"{factor} {level}", cycles)
    for (shape, material, tip), cycles in by_group(runs).items():
        name = f"{shape}, {material}, tip {tip}"
        rows += quantile_rows(name, "distance from the goal", distances(cycles), "mm")
    for case, trials in runs.items():
        for what, done in outcomes(trials).items():
            share = float(np.mean(done))
            rows.append(Row.info(str(case), f"{what}, share", share, "", spread=0.2))
    (_, most), (least, _) = (bounds(factors["tip"][tip]) for tip in TIPS)
    name, quantity = (
        f"tip {CORRECTED}",
        f"placed: least share; expected: most {AS_DRAWN}",
    )
    rows.append(Row.at_least(name, quantity, most, least, "", spread=0.05))
    return rows


def draw(runs: _Runs) -> Any:
    """Draw the shares of every combination by friction, and of every level."""
    count = len(next(iter(runs.values())))
    title = f"Which mended it, fingertips or tip? Trials of each combination: {count}"
    figure = make_figure(11.0, 4.4, title)
    *panels, mends = figure.subplots(1, 3, sharey=True)
    panels[0].set_ylim(-0.03, 1.03)
    for axes, tip in zip(panels, TIPS, strict=True):
        style_axes(axes, xlabel="friction between pad and cylinder")
        axes.set_title(f"tip {tip}", fontsize=9, loc="left")
        pads = list(itertools.product(MODELS, MATERIALS))
        for k, ((shape, material), color) in enumerate(zip(pads, COLORS, strict=False)):
            cycles = [runs[Case(Pads(shape, material, f), tip)] for f in FRICTION]
            at = np.array(FRICTION) + 0.01 * (k - 1.5)
            label = f"{shape}, {material}" if axes is panels[0] else None
            _draw_shares(axes, at, cycles, fmt="o-", ms=4, color=color, label=label)
    style_axes(mends)
    mends.set_title("each level, whatever the rest", fontsize=9, loc="left")
    found = levels(runs)
    ticks: list[str] = []
    for factor, color in zip(("tip", "shape", "material"), COLORS[4:], strict=True):
        at = np.arange(2.0) + len(ticks)
        _draw_shares(mends, at, [*found[factor].values()], fmt="o", color=color)
        ticks += found[factor]
    ticks[:2] = [f"tip\n{tip}" for tip in ticks[:2]]
    mends.set_xticks(range(len(ticks)), ticks)
    panels[0].set_ylabel("share placed, with 95 % interval", fontsize=9)
    figure.legend(loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return figure


def _draw_shares(
    axes: Any, at: Vector, trials: Sequence[Sequence[Cycle]], **style: Any
) -> None:
    """Draw shares of placed cylinders with their intervals."""
    shares = np.array([np.mean(outcomes(cycles)[PLACED]) for cycles in trials])
    low, high = np.transpose([bounds(cycles) for cycles in trials])
    axes.errorbar(at, shares, (shares - low, high - shares), lw=1.0, **style)
