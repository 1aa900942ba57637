"""Placing into a recess by a stiff and by a compliant arm, with errors of the goal.

The kitchen's arm has taken a cylinder out of a recess that leaves 1 mm all around, and
sets it back where it believes the recess to be. Only contact corrects its error.
Friction and mass are drawn for each grasp, the error's direction and height for each
insertion. Both drivers and all sizes of the error get the same draws.

The criteria were set before the first run. A yielding arm must seat the cylinder up to
an error of 1 mm; and the hypothesis is that a stiff one jams there, mostly.
"""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.experiments.insertion_stand import Inserted, InsertionStand
from drake_srg.experiments.kept_trials import KeptTrials
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.recording.timeline import make_figure, style_axes
from drake_srg.sweeps.statistics import wilson_interval

# The compliant arm has Sunrise's default stiffness; its centre is the cylinder's lower
# end, where forces then turn nothing (Whitney, "Quasi-Static Assembly of Compliantly
# Supported Rigid Parts", J. Dyn. Sys., Meas., Control 104, 1982).
DRIVERS = {
    "position": "!ArmPositionDriver {}",
    "impedance": "!ArmImpedanceDriver {cartesian: "
    "{frame: 'gripper::palm', centre: [0.198, 0.0, 0.0]}}",
}
ERRORS = (0.0, 0.5e-3, 1.0e-3, 1.5e-3, 2.0e-3)  # in the plane [m]
_DEEPEST = 2e-3  # the goal is up to this much too low [m]
_FRICTION, _MASS = (0.3, 0.8), (0.016, 0.024)  # drawn evenly; mass [kg]
# Seated: so near to the floor of the recess, and so upright.
_SEATED, _UPRIGHT = 0.5e-3, np.deg2rad(1.0)
# Criteria: the least share of insertions that seat with a compliant arm (lower bound),
# up to this error [m]; and of those that jam with a stiff one, at this error.
_CLEARANCE, _SEATING, _JAMMING = 1.0e-3, 0.9, 0.5


@dc.dataclass(frozen=True)
class Case:
    """A driver and the size of the error in the plane [m]."""

    driver: str
    error: float

    def __str__(self) -> str:
        return f"{self.driver}, {1e3 * self.error:.1f} mm"


def seated(trial: Inserted) -> bool:
    """Return whether the cylinder stands in the recess once let go."""
    return abs(trial.height) < _SEATED and trial.tilt < _UPRIGHT


def jammed(trial: Inserted) -> bool:
    """Return whether the cylinder was not at the floor when the arm had come down."""
    return trial.stood > _SEATED


def run(
    track: Track,
    *,
    grasps: int = 20,
    insertions: int = 10,
    time_step: float = 0.002,
    keep: str = "",
    quick: bool = False,
) -> ExperimentResult:
    """Set the cylinder back many times, with each driver and error.

    Args:
        track: Shows progress.
        grasps: Number of grasps, each with its own friction and mass.
        insertions: Number of insertions after each grasp, driver and error.
        time_step: Of the plant [s].
        keep: File of finished grasps, with which a run goes on that was cut off; ""
            keeps nothing. Delete it after a change of the code.
        quick: Whether to run a single insertion each.
    """
    if quick:
        grasps = insertions = 1
    kept = KeptTrials(keep)
    trials: dict[Case, list[Inserted]] = {
        Case(driver, error): [] for driver in DRIVERS for error in ERRORS
    }
    batches = [(seed, driver) for seed in range(grasps) for driver in DRIVERS]
    for seed, driver in track(batches, lambda batch: f"grasp {batch[0]}, {batch[1]}"):
        name = f"{seed}, {driver}, {insertions}, {time_step}"
        made = kept(name, functools.partial(grasp, seed, driver, insertions, time_step))
        for error, rows in zip(ERRORS, made["trials"], strict=True):
            trials[Case(driver, error)] += [Inserted(*row) for row in rows]
    lines = [
        {"driver": case.driver, "error [m]": case.error, **dc.asdict(trial)}
        for case, own in trials.items()
        for trial in own
    ]
    table = {key: [line[key] for line in lines] for key in lines[0]}
    return ExperimentResult(judge(trials), {"insertions": table}, draw(trials))


def grasp(
    seed: int, driver: str, insertions: int, time_step: float
) -> Mapping[str, Any]:
    """Return the insertions after one grasp: for each error, their `Inserted` as lists.

    Args:
        seed: Of friction, mass, directions and heights.
        driver: Name in `DRIVERS`.
        insertions: Their number for each error.
        time_step: Of the plant [s].
    """
    random = np.random.default_rng(seed)
    friction, mass = random.uniform(*_FRICTION), random.uniform(*_MASS)
    angles = random.uniform(0.0, 2.0 * np.pi, insertions)
    depths = random.uniform(0.0, _DEEPEST, insertions)
    stand = InsertionStand(DRIVERS[driver], mass, friction, time_step)
    return {
        "trials": [
            [
                dc.astuple(
                    stand.insert(
                        np.array([error * np.cos(angle), error * np.sin(angle), -depth])
                    )
                )
                for angle, depth in zip(angles, depths, strict=True)
            ]
            for error in ERRORS
        ]
    }


def judge(trials: Mapping[Case, Sequence[Inserted]]) -> Sequence[Row]:
    """Expect the compliant arm to seat within the clearance, the stiff one to jam."""
    rows = []
    for case, own in trials.items():
        name = str(case)
        for what, count in (
            ("seated", sum(map(seated, own))),
            ("jammed", sum(map(jammed, own))),
        ):
            share = count / len(own)
            low, high = wilson_interval(count, len(own))
            if what == "seated" and _must_seat(case):
                rows.append(
                    Row.at_least(
                        name, "seated, at least", _SEATING, low, "", spread=0.05
                    )
                )
            else:
                rows.append(Row.info(name, f"{what}, at least", low, "", spread=0.05))
            if case == Case("position", _CLEARANCE) and what == "jammed":
                hypothesis = Row.at_least(
                    name, "jammed, share", _JAMMING, share, "", spread=0.05
                )
                rows.append(hypothesis.because("the hypothesis is refuted"))
            else:
                rows.append(Row.info(name, f"{what}, share", share, "", spread=0.05))
            rows.append(Row.info(name, f"{what}, at most", high, "", spread=0.05))
        for what, forces in (
            ("peak force", [t.peak for t in own]),
            ("force when pressed", [t.pressed for t in own]),
        ):
            middle, high = np.quantile(forces, (0.5, 0.95))
            rows.append(Row.info(name, f"{what}, median", float(middle), "N"))
            rows.append(Row.info(name, f"{what}, 95 % quantile", float(high), "N"))
    return rows


def _must_seat(case: Case) -> bool:
    return case.driver == "impedance" and case.error <= _CLEARANCE


def draw(trials: Mapping[Case, Sequence[Inserted]]) -> Any:
    """Draw the shares, with intervals, and the forces, with 5 to 95 % of them."""
    figure = make_figure(10.0, 3.2, "A cylinder set into a recess of 1 mm clearance")
    axes = figure.subplots(1, 3)
    labels = "seated, share", "peak force [N]", "force when pressed [N]"
    for axis, label in zip(axes, labels, strict=True):
        style_axes(axis, xlabel="error of the goal [mm]", ylabel=label)
    x = 1e3 * np.array(ERRORS)
    for i, driver in enumerate(DRIVERS):
        own = [trials[Case(driver, error)] for error in ERRORS]
        counts = [sum(map(seated, batch)) for batch in own]
        share = np.array([n / len(b) for n, b in zip(counts, own, strict=True)])
        bounds = np.array(
            [wilson_interval(n, len(b)) for n, b in zip(counts, own, strict=True)]
        )
        plots = [(share, bounds[:, 0], bounds[:, 1])]
        for force in ("peak", "pressed"):
            values = [[getattr(trial, force) for trial in batch] for batch in own]
            low, middle, high = np.quantile(values, (0.05, 0.5, 0.95), axis=1)
            plots.append((middle, low, high))
        for axis, (y, low, high) in zip(axes, plots, strict=True):
            spread = np.maximum([y - low, high - y], 0.0)
            axis.errorbar(x + 0.04 * i, y, spread, fmt="o-", ms=4, lw=1.2, capsize=3)
    axes[0].set_ylim(0.0, 1.05)
    axes[0].legend(list(DRIVERS), fontsize=8, frameon=False, loc="lower left")
    return figure
