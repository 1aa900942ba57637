"""Whether fingers that press on each other chatter when the hand is closed on nothing.

Both fingers press on each other with the full force of their driver, at several time
steps, for as long as the payload experiments hold a load. When the hand points down,
the weight of the fingers presses evenly. With one finger above the other, it moves both
slowly until the drive balances it.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence
from typing import Any

import numpy as np

from drake_srg.experiments.registry import Track
from drake_srg.experiments.response import rms
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.gripper.sensors import TouchConfig
from drake_srg.recording.timeline import make_figure, style_axes
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Vector

DRIVERS = ("SrgPositionDriver", "SrgTendonDriver")
# Roll, pitch and yaw of the palm [degrees].
HANDS = {"pointing down": (0, 90, 0), "finger above finger": (90, 0, 0)}
# One count per second of the servo's 12-bit encoder: too slow to measure [rad/s].
SPEED_LIMIT = 2.0 * np.pi / 4096.0
# Resolution of thin-film force sensors, as a share of the mean force.
FORCE_SHARE = 0.01
_WINDOW = 0.05  # covered by each row of the tables [s]


@dc.dataclass(frozen=True)
class Case:
    """A driver, a pose of the hand and a time step [s]."""

    driver: str
    hand: str
    time_step: float

    def __str__(self) -> str:
        return f"{self.driver}, {self.hand}, {1e3 * self.time_step:g} ms"


@dc.dataclass(frozen=True)
class Closed:
    """Measurements of a closed hand, sampled every time step.

    Attributes:
        time: Shape (K,) [s].
        speeds: Of the four finger joints, shape (K, 4) [rad/s].
        force: Reading of the left fingertip's sensor, shape (K,) [N].
    """

    time: Vector
    speeds: Vector
    force: Vector


def close(case: Case, duration: float) -> Closed:
    """Close an open hand on nothing, for a duration [s]."""
    overrides = [
        f"gripper=!{case.driver} {{}}",
        f"plant_config.time_step={case.time_step}",
    ]
    scenario = bench_scenario(gripper_rpy=HANDS[case.hand], overrides=overrides)
    scenario.objects, scenario.task.pick = {}, ""
    with Rig(
        scenario,
        name="idle_contact",
        period=case.time_step,
        log_period=case.time_step,
    ) as rig:
        rig.advance(duration, closure=1.0)
        log = rig.log()
    force = log["gripper.contact_force"][:, 2]  # left base, right base, left tip, ...
    return Closed(log["time"], log["gripper.state_measured"][:, 4:], force)


def run(
    track: Track,
    *,
    time_steps: Sequence[float] = (0.001, 0.002, 0.005),
    duration: float = 10.0,
) -> ExperimentResult:
    """Close every hand with every driver at every time step.

    Args:
        track: Shows progress.
        time_steps: Of the plant [s].
        duration: Of each run, whose last second is judged [s].
    """
    cases = [Case(d, h, dt) for d in DRIVERS for h in HANDS for dt in time_steps]
    closed = {case: close(case, duration) for case in track(cases)}
    rows = [row for case, response in closed.items() for row in judge(case, response)]
    tables: dict[str, dict[str, Vector]] = {}
    for case, response in closed.items():
        name = f"{case.driver}, {case.hand}".replace(", ", "_").replace(" ", "_")
        table = tables.setdefault(name, {})
        time, speed, low, high = _windows(case, response)
        step = f"{1e3 * case.time_step:g} ms"
        table["time [s]"] = time
        table[f"{step}: joint speed, RMS [rad/s]"] = speed
        table[f"{step}: smallest force [N]"] = low
        table[f"{step}: largest force [N]"] = high
    return ExperimentResult(rows, tables, draw(closed))


def judge(case: Case, response: Closed) -> Sequence[Row]:
    """Judge the last second of a response."""
    last = response.time > response.time[-1] - 1.0
    force = response.force[last]
    mean = float(np.mean(force))
    speed = max(rms(v) for v in response.speeds[last].T)
    touch = TouchConfig().trigger_force
    name = str(case)
    return (
        Row.at_least(name, "contact force, mean", touch, mean, "N"),
        Row.at_most(name, "fastest joint's speed, RMS", SPEED_LIMIT, speed, "rad/s"),
        Row.at_most(
            name,
            "contact force, peak to peak",
            FORCE_SHARE * mean,
            float(np.ptp(force)),
            "N",
        ),
    )


def _windows(case: Case, response: Closed) -> tuple[Vector, ...]:
    """Return end, largest RMS speed, smallest and largest force of each window."""
    n = round(_WINDOW / case.time_step)
    count = (len(response.time) - 1) // n
    speeds = response.speeds[1 : 1 + n * count].reshape(count, n, -1)
    force = response.force[1 : 1 + n * count].reshape(count, n)
    speed = np.max(np.sqrt(np.mean(speeds**2, axis=1)), axis=1)
    ends: Vector = response.time[n::n][:count]
    return ends, speed, np.min(force, axis=1), np.max(force, axis=1)


def draw(closed: dict[Case, Closed]) -> Any:
    """Draw joint speed above contact force, a column for each driver and hand."""
    columns = list(dict.fromkeys((case.driver, case.hand) for case in closed))
    figure = make_figure(11.0, 5.0, "Closed on nothing")
    shape = (2, len(columns))
    all_axes = figure.subplots(*shape, sharex=True, sharey="row", squeeze=False)
    for speed_axes, force_axes in all_axes.T:
        style_axes(speed_axes)
        style_axes(force_axes, xlabel="time [s]")
    for case, response in closed.items():
        speed_axes, force_axes = all_axes[:, columns.index((case.driver, case.hand))]
        time, speed, low, high = _windows(case, response)
        label = f"{1e3 * case.time_step:g} ms"
        (line,) = speed_axes.semilogy(time, speed, lw=1.2, label=label)
        force_axes.plot(time, low, time, high, color=line.get_color(), lw=1.2)
    for (driver, hand), axes in zip(columns, all_axes[0], strict=True):
        axes.set_title(f"{driver}\n{hand}", fontsize=9, loc="left")
        axes.axhline(SPEED_LIMIT, color="#333333", ls="--", lw=0.8)
    all_axes[0, 0].set_ylabel("joint speed, RMS\n[rad/s]", fontsize=9)
    all_axes[1, 0].set_ylabel("fingertip force,\nsmallest and largest [N]", fontsize=9)
    all_axes[0, 0].annotate(
        "one encoder count per second",
        (max(float(c.time[-1]) for c in closed.values()), SPEED_LIMIT),
        xytext=(0, 3),
        textcoords="offset points",
        ha="right",
        fontsize=7,
    )
    all_axes[0, -1].legend(fontsize=8, frameon=False, title="time step")
    return figure
