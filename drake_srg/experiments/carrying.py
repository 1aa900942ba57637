"""How far a cylinder slides in the hand that carries it, at several time steps.

Contact without slip gives a held object the hand's velocity at the beginning of each
step. The step then moves the object along a straight line, while the joints move the
hand along a curve. So in each step h the object leaves the path outwards by h^2 a_n /
2, where a_n is the acceleration across the path, and friction sees no slip to act
against. Over a motion this adds up to h/2 times the integral of a_n. Unless the pads
hold the object back, it slides by that distance, which vanishes with the step.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence
from typing import Any

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.log_format import pose_key
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.whole_run import simulate_whole
from drake_srg.recording.timeline import make_figure, style_axes
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Mode, Vector

# Scenario, the key of its time step, and steps, each half the one before [s]. The
# integrator of the fast scenario takes each step in two halves.
STEPS: dict[str, tuple[str, tuple[float, ...]]] = {
    "assistive_arm": ("plant_config.time_step", (0.005, 0.0025, 0.00125)),
    "assistive_arm_fast": (
        "simulator_config.max_step_size",
        (0.01171875, 0.005859375, 0.0029296875),
    ),
}
# Largest slide beyond the effect of the steps [m]: a fifth of the recess's clearance.
LIMIT = 0.2e-3


@dc.dataclass(frozen=True)
class Case:
    """A scenario and its time step."""

    scenario: str
    step: float  # s

    def __str__(self) -> str:
        return f"{self.scenario}, {1e3 * self.step:.3g} ms"


@dc.dataclass(frozen=True)
class Carried:
    """A cylinder while the arm transfers it.

    Attributes:
        time: Shape (K,) [s].
        slide: Distance in the hand from the position at the start, shape (K,) [m].
        leaving: Distance by which all steps together leave the path, shape (K,) [m].
    """

    time: Vector
    slide: Vector
    leaving: Vector


def carry(case: Case) -> Carried:
    """Run a scenario and return how the cylinder slides during the transfer.

    Raises:
        ScenarioError: If the arm carries nothing.
    """
    key, steps = STEPS[case.scenario]
    # A multiple of every step: a log sample within a step would cut the step short.
    period = 2 * steps[0] if steps[0] < 0.01 else steps[0]
    overrides = [f"{key}={case.step}", f"recording.period={period}"]
    scenario = load_scenario(case.scenario, overrides=overrides)
    log = simulate_whole(scenario, name=str(case)).log
    while_carried = np.flatnonzero(log["mode"] == list(Mode).index(Mode.TRANSFER))
    if not len(while_carried):
        raise ScenarioError(f"carrying: {case}: the arm carries nothing")
    log = {name: values[while_carried] for name, values in log.items()}
    time, p_WO = log["time"], log[pose_key(scenario.task.pick)][:, :3]
    p_GO = _in_hand(scenario, log["arm.state_cheat"], p_WO)
    halves = 2 if case.scenario.endswith("_fast") else 1
    return Carried(
        time - time[0],
        np.linalg.norm(p_GO - p_GO[0], axis=1),
        leaving(time, p_WO, case.step / halves),
    )


def _in_hand(scenario: Scenario, states: Vector, p_WO: Vector) -> Vector:
    """Return positions (K, 3) [m] in the palm frame.

    Args:
        scenario: Names arm and models.
        states: Of the arm, a row per position.
        p_WO: Positions in world, shape (K, 3) [m].
    """
    plant = MakeModelsPlant(scenario)
    context, palm = plant.CreateDefaultContext(), plant.GetBodyByName("palm")
    arm = plant.GetModelInstanceByName("arm")
    p_GO = []
    for state, p in zip(states, p_WO, strict=True):
        plant.SetPositionsAndVelocities(context, arm, state)
        X_WG = plant.EvalBodyPoseInWorld(context, palm)
        p_GO.append(X_WG.inverse() @ p)
    return np.array(p_GO)


def leaving(time: Vector, position: Vector, step: float) -> Vector:
    """Return the distance by which steps leave a path up to each time, (K,) [m].

    Args:
        time: Shape (K,) [s].
        position: Of a body on the path, shape (K, 3) [m].
        step: Time step [s].
    """
    v = np.gradient(position, time, axis=0)
    a = np.gradient(v, time, axis=0)
    speed = np.linalg.norm(v, axis=1)
    across = np.linalg.norm(np.cross(v, a), axis=1) / np.maximum(speed, 1e-9)
    return np.asarray(0.5 * step * np.cumsum(across * np.gradient(time)))


def run(track: Track) -> ExperimentResult:
    """Carry the cylinder at every step."""
    cases = [Case(name, h) for name, (_, steps) in STEPS.items() for h in steps]
    carried = {case: carry(case) for case in track(cases)}
    tables = {
        str(case).replace(", ", "_").replace(" ", "_"): {
            "time [s]": c.time,
            "slide [m]": c.slide,
            "slide caused by the steps [m]": c.leaving,
        }
        for case, c in carried.items()
    }
    return ExperimentResult(judge(carried), tables, draw(carried))


def judge(carried: dict[Case, Carried]) -> Sequence[Row]:
    """Judge the largest slides; the steps cause all of them."""
    rows = []
    for name, (_, steps) in STEPS.items():
        largest = [float(np.max(carried[Case(name, h)].slide)) for h in steps]
        for h, slide in zip(steps, largest, strict=True):
            case = Case(name, h)
            by_step = float(carried[case].leaving[-1])
            rows += [
                Row.info(str(case), "slide caused by the steps", 1e3 * by_step, "mm"),
                Row.at_most(
                    str(case),
                    "slide in the hand",
                    1e3 * (by_step + LIMIT),
                    1e3 * slide,
                    "mm",
                ),
            ]
        # Richardson extrapolation of a first-order error.
        rest = abs(2.0 * largest[-1] - largest[-2])
        text = "slide in the hand, extrapolated to step 0"
        rows.append(Row.at_most(name, text, 1e3 * LIMIT, 1e3 * rest, "mm"))
    return rows


def draw(carried: dict[Case, Carried]) -> Any:
    """Draw slides over time, a panel per scenario."""
    figure = make_figure(9.0, 3.4, "Slide of a carried cylinder")
    panels = figure.subplots(1, len(STEPS), sharey=True)
    for axes, name in zip(panels, STEPS, strict=True):
        style_axes(axes, xlabel="time [s]")
        axes.set_title(name, fontsize=9, loc="left")
        for case, c in carried.items():
            if case.scenario == name:
                label = f"{1e3 * case.step:.3g} ms"
                (line,) = axes.plot(c.time, 1e3 * c.slide, lw=1.2, label=label)
                axes.plot(
                    c.time, 1e3 * c.leaving, color=line.get_color(), ls="--", lw=0.8
                )
        axes.legend(fontsize=8, frameon=False, title="step")
    panels[0].set_ylabel(
        "slide in the hand [mm]\n(dashed: caused by the steps)", fontsize=9
    )
    return figure
