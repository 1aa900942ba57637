"""A hand closing around a can, gently: impact, steady force and shift of the can.

Algorithm 1 drives a base whose sensor has fired on to its last target, which is the
full closure after a step command, but hardly beyond the sensor's angle after the ramp
that the thesis's client sends. A base that freezes stops by itself.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from drake_srg.experiments.closing import (
    LOG_PERIOD,
    START,
    TOUCHED,
    can_in_hand,
    first,
    shifts,
)
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.simulation.rig import Rig
from drake_srg.types import Vector

# The client's ramp: message i of 0 to 1000 says floor(i / 10) percent.
_RATE, _LAST = 25.0, 1000  # messages/s
# The arm lifts the closed hand by this, in this time, and waits as long [m], [s].
_LIFT, _LIFT_TIME = 0.1, 1.0
# A can that moves further in the hand meanwhile is not held, as in payload_wrap [m].
_HELD_WITHIN = 0.005
# A gentle closing may take this much longer than a step [s].
_LONGER = 0.1


@dc.dataclass(frozen=True)
class Case:
    """A way to close the hand.

    Attributes:
        underactuation: Of the driver, as in a scenario file.
        closure: Commanded closure at a time since the start [s].
        duration: Of the closing [s].
        trigger_distance: At which proximity sensors fire [m].
    """

    underactuation: str
    closure: Callable[[float], float] = lambda t: 1.0
    duration: float = 2.9
    trigger_distance: float = 0.003


def ramp(t: float) -> float:
    """Return what the client's ramp commands at a time [s]: 0 open .. 1 closed."""
    # A message belongs to the sample at its time, whatever way that is rounded.
    return min(int(t * _RATE + 1e-9), _LAST) // 10 / 100.0


STEP, RAMP, FREEZE, APPROACH = "step", "ramp", "freeze", "freeze, approach"
CASES = {
    STEP: Case("{base: algorithm_1}"),
    RAMP: Case("{base: algorithm_1}", ramp, _LAST / _RATE + 1.0),
    FREEZE: Case("{base: freeze}"),
    "freeze at 2 mm": Case("{base: freeze}", trigger_distance=0.002),
    APPROACH: Case("{base: freeze, approach_speed: 1.0}"),
}


@dc.dataclass(frozen=True)
class Closing:
    """Measurements of a closing hand; sensors in order of `JOINT_NAMES`.

    Attributes:
        time: Since the command to close, shape (K,) [s].
        proximity: Signed distances, shape (K, 4) [m].
        touch: Forces on the closing sides, shape (K, 4) [N].
        shift: Motion of the can on the table, shape (K,) [m].
        slip: Motion of the can in the hand that then lifts it [m].
    """

    time: Vector
    proximity: Vector
    touch: Vector
    shift: Vector
    slip: float

    @property
    def grasped(self) -> float:
        """When both tips have touched [s]; NaN if they never do."""
        return first(self.time, np.min(self.touch[:, 2:], axis=1) >= TOUCHED)

    @property
    def before(self) -> Any:
        """The rows before a tip touches, shape (K,)."""
        return np.cumsum(np.max(self.touch[:, 2:], axis=1) >= TOUCHED) == 0

    @property
    def impact(self) -> float:
        """Largest force of a base before a tip touches [N]."""
        return float(np.max(self.touch[self.before, :2]))

    @property
    def steady(self) -> float:
        """Force of the bases at the end, their mean [N]."""
        return float(np.mean(self.touch[-1, :2]))

    @property
    def largest_shift(self) -> float:
        """Largest motion of the can [m]."""
        return float(np.max(self.shift))


def close(case: Case, time_step: float) -> Closing:
    """Close the hand around the can and lift it.

    Args:
        case: How.
        time_step: Of the plant [s].
    """
    scenario = can_in_hand(
        f"!SrgPositionDriver {{underactuation: {case.underactuation}, "
        f"proximity: {{trigger_distance: {case.trigger_distance}}}}}",
        [f"plant_config.time_step={time_step}"],
    )
    with Rig(scenario, name="closing_gently", log_period=LOG_PERIOD) as rig:
        rig.advance(START)
        rig.advance(case.duration, closure=case.closure)
        log = rig.log()
        closed = rig.X_GO().translation()
        home = rig.commanded("arm.position_commanded")
        rig.move(home + np.array([0.0, 0.0, _LIFT]), _LIFT_TIME)
        rig.advance(_LIFT_TIME)
        lifted = rig.X_GO().translation()
    return Closing(
        time=log["time"] - START,
        proximity=log["gripper.proximity"],
        touch=log["gripper.contact_force"],
        shift=shifts(log),
        slip=float(np.linalg.norm(lifted - closed)),
    )


def run(track: Track, *, time_step: float = 0.002) -> ExperimentResult:
    """Close the hand in every way.

    Args:
        track: Shows progress.
        time_step: Of the plant [s].
    """
    closings = {name: close(CASES[name], time_step) for name in track(list(CASES))}
    rows = [row for name, closing in closings.items() for row in judge(name, closing)]
    rows += compare(closings[STEP], closings[APPROACH])
    tables = {
        name.replace(",", "").replace(" ", "_"): _columns(closing)
        for name, closing in closings.items()
    }
    return ExperimentResult(rows, tables, draw(closings))


def judge(name: str, closing: Closing) -> list[Row]:
    """Measure a closing, and expect that it holds the can.

    The thesis promises that no force moves the object until the tip closes: a base that
    stops before it touches must keep that.
    """
    quantity = "base force before the tip touches"
    impact = Row.info(name, quantity, closing.impact, "N")
    if name in (RAMP, FREEZE):
        impact = Row.at_most(name, quantity, TOUCHED, closing.impact, "N")
    clearance = float(np.min(closing.proximity[closing.before, :2]))
    return [
        impact,
        Row.info(name, "clearance of the base until then", 1e3 * clearance, "mm"),
        Row.info(name, "base force at the end", closing.steady, "N"),
        Row.info(
            name, "tip force at the end", float(np.mean(closing.touch[-1, 2:])), "N"
        ),
        _shift(name, "largest shift of the can", closing.largest_shift),
        _shift(name, "shift at the end", float(closing.shift[-1])),
        Row.info(name, "both tips touch after", closing.grasped, "s"),
        Row.at_most(
            name,
            "slip in the hand that lifts the can",
            1e3 * _HELD_WITHIN,
            1e3 * closing.slip,
            "mm",
        ),
    ]


def _shift(name: str, quantity: str, shift: float) -> Row:
    """Return a row of a shift [m]; what is below 0.02 mm differs from run to run."""
    spread = max(0.02, 1e2 * shift)
    return Row.info(name, quantity, 1e3 * shift, "mm", spread=spread)


def compare(step: Closing, gentle: Closing) -> list[Row]:
    """Expect a gentle closing to be better than a step in all, and about as fast."""
    name = f"{APPROACH}, less than {STEP}"
    return [
        Row.at_most(name, "base force, impact", step.impact, gentle.impact, "N"),
        Row.at_most(name, "base force at the end", step.steady, gentle.steady, "N"),
        Row.at_most(
            name,
            "largest shift of the can",
            1e3 * step.largest_shift,
            1e3 * gentle.largest_shift,
            "mm",
        ),
        Row.at_most(
            name,
            f"both tips touch after, up to {_LONGER:g} s later",
            step.grasped + _LONGER,
            gentle.grasped,
            "s",
        ),
    ]


def _columns(closing: Closing) -> dict[str, Vector]:
    """Return the means of both fingers, a row per 10 ms, the period of the sensors."""
    columns = {"time [s]": closing.time[::5]}
    for name, sides in (("base", slice(0, 2)), ("tip", slice(2, 4))):
        columns[f"{name}: proximity [m]"] = closing.proximity[::5, sides].mean(axis=1)
        columns[f"{name}: touch [N]"] = closing.touch[::5, sides].mean(axis=1)
    columns["motion of the can [m]"] = closing.shift[::5]
    return columns


def draw(closings: Mapping[str, Closing]) -> Any:
    """Draw distance, touch and shift over time, a column per way to close."""
    figure = make_figure(12.0, 6.0, "Closing gently around a can")
    shape = (3, len(closings))
    all_axes = figure.subplots(*shape, sharex="col", sharey="row", squeeze=False)
    labels = ("proximity [mm]", "touch [N]", "shift of the can [mm]")
    for k, (name, closing) in enumerate(closings.items()):
        for i, (axes, label) in enumerate(zip(all_axes[:, k], labels, strict=True)):
            style_axes(
                axes,
                xlabel="time since the command [s]" if i == 2 else "",
                ylabel=label if k == 0 else "",
            )
            if np.isfinite(closing.grasped):
                axes.axvline(closing.grasped, color=COLORS[1], lw=0.8, alpha=0.5)
        all_axes[0, k].set_title(name, fontsize=9, loc="left")
        for axes, values in zip(
            all_axes[:2, k], (1e3 * closing.proximity, closing.touch), strict=True
        ):
            for link, sides in (("base", slice(0, 2)), ("tip", slice(2, 4))):
                axes.plot(
                    closing.time, values[:, sides].mean(axis=1), lw=1.3, label=link
                )
        all_axes[2, k].plot(closing.time, 1e3 * closing.shift, color=COLORS[2], lw=1.3)
    all_axes[0, 0].legend(fontsize=8, frameon=False)
    figure.align_ylabels(all_axes[:, 0])
    return figure
