"""From a command to a grip: counts, wire, current, wire force, pad force and payload.

The hand closes on boxes of 20, 68 and 140 mm with rising effort, each from the open
hand. One table and one figure are what owners of the gripper need (docs/gripper.md).
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.srg_geometry import SRG
from drake_srg.experiments.grasp_width_cases import HEIGHT, box
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.gripper.driver import WireMotor
from drake_srg.gripper.srg_tendon_driver import SpoolCommandConfig, spool_angle
from drake_srg.gripper.tendon import motor_load
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.scenario import Scenario
from drake_srg.simulation.rig import Rig, bench_scenario

_COUNTS = 4096 / (2.0 * np.pi)  # per rad
_RANGE = 2500  # counts from closed to open, 100 % of SAKE's driver
_REGISTER = 800  # torque limit of 100 % effort, see TendonDriveConfig.full_scale
_FRICTION, _GRAVITY = 0.8, 9.81  # of painted metal on rubber; m/s²
_SETTLE = 2.5  # s
# Wide boxes are gripped near the palm, the others between the middles of the pads.
_WIDE = 0.1  # m


@dc.dataclass(frozen=True)
class Rung:
    """A grip at rest.

    Attributes:
        angle: Of the spool from open [rad].
        current: The servo's estimate [A].
        wire_force: Mean of both wires [N].
        pad_force: Mean of both fingers, on the object [N].
    """

    angle: float
    current: float
    wire_force: float
    pad_force: float


def grip(width: float, effort: float, scenario: str) -> Rung:
    """Close on a box that stands on the table.

    Args:
        width: Of the box [m].
        effort: Force limit of the servo, 0 .. 1.
        scenario: The bench.
    """
    thing = box(width)
    height = thing.z if width > _WIDE else 0.7 * HEIGHT + SRG.grasp_center_x
    bench = bench_scenario(thing.config, home=[0.0, 0.0, height], scenario=scenario)
    motor = wire_motor(bench)
    with Rig(bench, name="grip_ladder") as rig:
        rig.advance(_SETTLE, closure=1.0, force_limit=effort)
        angle, speed = rig.measured("gripper.motor_state")
        load = motor_load(motor.drive, float(rig.measured("gripper.pwm")[0]), speed)
        wires = float(np.mean(rig.measured("gripper.wire_force")))
        pads = 0.5 * float(np.sum(rig.measured("gripper.contact_force")))
    return Rung(float(angle), load * motor.temperature.stall_current, wires, pads)


def wire_motor(bench: Scenario) -> WireMotor:
    """Return the motor of a bench's gripper.

    Raises:
        ScenarioError: If the gripper has no wires.
    """
    motor = None if bench.gripper is None else bench.gripper.wire_motor
    if motor is None:
        raise ScenarioError("scenario: gripper: needs !SrgTendonDriver")
    return motor


def closure_of(angle: float, radius: float) -> float:
    """Return the closure that commands a spool angle [rad], 0 .. 1."""
    closures = np.linspace(0.0, 1.0, 501)
    config = SpoolCommandConfig()
    angles = [spool_angle(c, radius, config) for c in closures]
    return float(np.interp(angle, angles, closures))


def run(
    track: Track,
    *,
    scenario: str = "srg_specimen",
    widths: Sequence[float] = (0.02, 0.068, 0.14),
    efforts: Sequence[float] = (0.2, 0.35, 0.5, 0.65, 0.8, 1.0),
) -> ExperimentResult:
    """Grip every box with every effort.

    Args:
        track: Shows progress.
        scenario: A bench whose gripper has wires.
        widths: Of the boxes [m].
        efforts: Shares of the range of SAKE's driver, 0 .. 1.
    """
    table: dict[str, list[Any]] = {name: [] for name in _COLUMNS}
    cases = [(width, effort) for width in widths for effort in efforts]
    rows = []
    radius = wire_motor(bench_scenario(scenario=scenario)).drive.spool_radius
    for width, effort in track(
        cases, label=lambda c: f"{1e3 * c[0]:.0f} mm, {100 * c[1]:.0f} %"
    ):
        rung = grip(width, effort, scenario)
        counts = rung.angle * _COUNTS
        payload = 2.0 * _FRICTION * rung.pad_force / _GRAVITY
        values = (
            *(1e3 * width, 100 * effort, round(effort * _REGISTER)),
            *(100 * closure_of(rung.angle, radius), 100 * (1 - counts / _RANGE)),
            *(counts, 1e3 * radius * rung.angle, 1e3 * rung.current),
            *(rung.wire_force, rung.pad_force, payload),
        )
        for column, value in zip(table.values(), values, strict=True):
            column.append(value)
        case = f"{1e3 * width:.0f} mm, {100 * effort:.0f} %"
        rows += [
            Row.info(case, "wire force", rung.wire_force, "N"),
            Row.info(case, "pad force", rung.pad_force, "N"),
        ]
    files = {"ladder.md": markdown(table)}
    return ExperimentResult(rows, {"ladder": table}, _draw(table, widths), files)


def markdown(table: Mapping[str, Sequence[float]]) -> str:
    """Return the table as in docs/gripper.md."""
    lines = [_HEADINGS, ["---:"] * len(_HEADINGS)]
    for values in zip(*table.values(), strict=True):
        lines.append(
            [f"{value:.{n}f}" for value, n in zip(values, _DIGITS, strict=True)]
        )
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


_COLUMNS = (
    *("width_mm", "effort_pct", "torque_limit", "closed_pct", "sake_pct", "counts"),
    *("wire_mm", "current_ma", "wire_force_n", "pad_force_n", "friction_payload_kg"),
)

_HEADINGS = [
    *("width [mm]", "effort [%]", "torque limit", "closed [%]", "SAKE [%]", "counts"),
    *("wire [mm]", "current [mA]", "wire force [N]", "finger force [N]"),
    "payload by friction [kg]",
]
_DIGITS = (0, 0, 0, 0, 0, 0, 1, 0, 0, 1, 1)


def _draw(table: dict[str, list[Any]], widths: Sequence[float]) -> Any:
    figure = make_figure(9.0, 3.4, "From effort to grip")
    panels = (
        ("current_ma", "estimated current [mA]"),
        ("wire_force_n", "force of each wire [N]"),
        ("pad_force_n", "force of each finger [N]"),
    )
    data = {name: np.array(values) for name, values in table.items()}
    for axes, (name, label) in zip(figure.subplots(1, 3), panels, strict=True):
        style_axes(axes, xlabel="effort [%]", ylabel=label)
        for width, color in zip(widths, COLORS, strict=False):
            these = data["width_mm"] == 1e3 * width
            axes.plot(
                data["effort_pct"][these],
                data[name][these],
                marker="o",
                ms=3.5,
                color=color,
                label=f"{1e3 * width:.0f} mm",
            )
        axes.set_ylim(0.0)
    axes.legend(fontsize=8, frameon=False)
    return figure
