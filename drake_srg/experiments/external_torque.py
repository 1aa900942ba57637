"""External torques of carrying arms and the limits of their protective stops."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence
from typing import Any

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.log_format import MODES
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.whole_run import simulate_whole
from drake_srg.recording.timeline import make_figure, style_axes
from drake_srg.scenario import load_scenario
from drake_srg.types import Mode, Vector

# Each cell on the fast and on the accurate physics. The former derives the torques from
# contacts, the latter estimates them from motors and motion.
CELLS = {
    "kitchen_varied": ("kitchen_varied", "kitchen_varied_accurate"),
    "assistive_arm_varied": ("assistive_arm_varied", "assistive_arm_varied_accurate"),
}
# Further seeds. With this one, the cylinder grazes the rim of its recess on the fast
# physics.
MORE_SEEDS = {"assistive_arm_varied": (800264,)}
# In these modes the hand carries an object, and the planner watches the torques.
_CARRYING = (Mode.LIFT, Mode.TRANSFER, Mode.PLACE)
# Largest torque in normal operation, as a share of a joint's limit.
_SHARE = 0.5


@dc.dataclass(frozen=True)
class Case:
    """A scenario and its seed."""

    scenario: str
    seed: int

    def __str__(self) -> str:
        return f"{self.scenario}, seed {self.seed}"


def feel(case: Case) -> Vector:
    """Return the largest torque of each joint during the carry, shape (N,) [N m].

    Raises:
        ScenarioError: If the arm carries nothing.
    """
    scenario = load_scenario(case.scenario, seed=case.seed)
    log = simulate_whole(scenario, name=str(case)).log
    carrying = np.isin(log["mode"], [MODES.index(mode) for mode in _CARRYING])
    if not np.any(carrying):
        raise ScenarioError(f"external_torque: {case}: the arm carries nothing")
    return np.asarray(np.max(np.abs(log["arm.external_torque"][carrying]), axis=0))


def run(track: Track, *, seeds: int = 10) -> ExperimentResult:
    """Run both cells on both physics.

    Args:
        track: Shows progress.
        seeds: Number of trials of each scenario.
    """
    trials = {
        name: [Case(name, seed) for seed in (*range(seeds), *MORE_SEEDS.get(cell, ()))]
        for cell, names in CELLS.items()
        for name in names
    }
    cases = [case for own in trials.values() for case in own]
    felt = {case: feel(case) for case in track(cases)}
    torques = {
        name: np.array([felt[case] for case in own]) for name, own in trials.items()
    }
    largest = {name: np.max(t, axis=0) for name, t in torques.items()}
    tables: dict[str, dict[str, Any]] = {
        name: {
            "seed": [case.seed for case in trials[name]],
            **{f"joint {i + 1} [N m]": joint for i, joint in enumerate(t.T)},
        }
        for name, t in torques.items()
    }
    stops = {cell: limits(cell) for cell in CELLS}
    return ExperimentResult(judge(largest, stops), tables, draw(largest, stops))


def limits(cell: str) -> Vector:
    """Return the torque limits of a cell's protective stop, shape (N,) [N m].

    Raises:
        ScenarioError: If the cell has no protective stop.
    """
    stop = load_scenario(cell, seed=0).planner.max_external_torque
    if stop is None:
        raise ScenarioError(f"external_torque: {cell}: needs a protective stop")
    return np.array(stop)


def judge(largest: dict[str, Vector], stops: dict[str, Vector]) -> Sequence[Row]:
    """Expect the largest torques to stay well below the limits."""
    return [
        Row.at_most(name, f"joint {i + 1}", _SHARE * stop, torque, "N m")
        for cell, names in CELLS.items()
        for name in names
        for i, (stop, torque) in enumerate(zip(stops[cell], largest[name], strict=True))
    ]


def draw(largest: dict[str, Vector], stops: dict[str, Vector]) -> Any:
    """Draw torques and limits by joint, a panel per cell."""
    figure = make_figure(9.0, 3.2, "External torques while carrying an object")
    panels = figure.subplots(1, len(CELLS))
    for axes, (cell, names) in zip(panels, CELLS.items(), strict=True):
        style_axes(axes, xlabel="joint")
        axes.set_title(cell, fontsize=9, loc="left")
        joints = np.arange(1, len(stops[cell]) + 1)
        axes.bar(joints, stops[cell], 0.8, color="0.88", label="protective stop")
        for shift, name, label in zip(
            (-0.2, 0.2), names, ("fast", "accurate"), strict=True
        ):
            axes.bar(joints + shift, largest[name], 0.36, label=f"{label} physics")
        axes.set_xticks(joints)
        axes.legend(fontsize=8, frameon=False)
    panels[0].set_ylabel("largest external torque [N m]", fontsize=9)
    return figure
