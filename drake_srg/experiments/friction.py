"""Friction of gears and wires, on and off: back-driving, hysteresis and creep.

The gears' friction is that which `drake-srg identify` finds in the vendor's log. No
measurement tells the wires'; they get the capstan friction of a polyethylene line on
metal (coefficient 0.1) around pulleys at base and tip hinge, 1.5 rad in all.
"""

from __future__ import annotations

import dataclasses as dc
from typing import Any

import numpy as np

from drake_srg.experiments.hold_drift import creep, things
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.gripper.tendon import DriveFrictionConfig
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.scenario import load_scenario
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Vector

WIRE = 0.15
_BENCH = "gripper_bench"
# Torque of the motor, share of that at full PWM: up and down again in equal steps.
_LADDER = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1)
_SETTLE = 0.8  # s
_MIDDLE = 0.3
_HOLD_FORCE = 107.0  # of each wire, around the held can [N]
_HELD = 5.0  # s


def frictions() -> dict[str, DriveFrictionConfig]:
    """Return the frictions to compare, by name."""
    gripper = load_scenario("srg_specimen").gripper
    assert gripper is not None and gripper.wire_motor is not None
    gears = gripper.wire_motor.drive.friction
    return {
        "none": DriveFrictionConfig(),
        "gears": gears,
        "wires": DriveFrictionConfig(wire=WIRE),
        "gears and wires": dc.replace(gears, wire=WIRE),
    }


def changes(friction: DriveFrictionConfig) -> dict[str, object]:
    """Return the bench's overrides for a friction."""
    entries = ", ".join(f"{k}: {v!r}" for k, v in dc.asdict(friction).items())
    return {"gripper.drive.friction": f"{{{entries}}}"}


@dc.dataclass(frozen=True)
class Loop:
    """A grip that tightens, relaxes and is released.

    Attributes:
        torque: Of the motor, share of full, shape (K,).
        wire: Mean force of the wires at rest, shape (K,) [N].
        pad: Mean force of the fingers on each other, shape (K,) [N].
        left: Force of the wires after the motor lost its power [N].
        opened: How far the fingers' bases opened by then [rad].
    """

    torque: Vector
    wire: Vector
    pad: Vector
    left: float
    opened: float


def measure_loop(friction: DriveFrictionConfig) -> Loop:
    """Press the tips on each other with rising and falling torque, then let go."""
    bench = bench_scenario(
        gripper_rpy=[0.0, 0.0, 0.0],
        overrides=[
            "object.present=false",
            *(f"{key}={value}" for key, value in changes(friction).items()),
        ],
    )
    wire, pad = [], []
    with Rig(bench, name="friction") as rig:
        rig.fix("gripper.force_limit", 1.0)
        rig.advance(1.5, closure=0.6)  # to near each other
        for torque in _LADDER:
            rig.fix("gripper.motor_torque_commanded", torque)
            rig.advance(_SETTLE)
            wire.append(float(np.mean(rig.measured("gripper.wire_force"))))
            force = rig.measured("gripper.contact_force")
            pad.append(0.5 * float(np.sum(force)))
        closed = rig.measured("gripper.state_measured")[0]
        rig.fix("gripper.motor_torque_commanded", 0.0)
        rig.advance(3.0)
        left = float(np.mean(rig.measured("gripper.wire_force")))
        opened = closed - rig.measured("gripper.state_measured")[0]
    ladder = np.array(_LADDER)
    return Loop(ladder, np.array(wire), np.array(pad), left, float(opened))


def run(track: Track) -> ExperimentResult:
    """Measure a loop and the creep of a held can, without and with friction.

    Args:
        track: Shows progress.
    """
    rows, loops = [], {}
    table: dict[str, list[Any]] = {
        "friction": [],
        "torque": [],
        "wire_force_n": [],
        "pad_force_n": [],
    }
    found = frictions()
    for name in track(list(found)):
        loop = loops[name] = measure_loop(found[name])
        for values in zip(loop.torque, loop.wire, loop.pad, strict=True):
            for column, value in zip(table.values(), (name, *values), strict=True):
                column.append(value)
        rows += judge(name, loop, loops["none"])
        bench = load_scenario(
            _BENCH, overrides=[f"{k}={v}" for k, v in changes(found[name]).items()]
        )
        assert bench.gripper is not None and bench.gripper.wire_motor is not None
        limit = bench.gripper.wire_motor.drive.force_limit_of(_HOLD_FORCE)
        _, moved = creep(*things()["can"], _BENCH, changes(found[name]), _HELD, limit)
        rate = 1e6 * float(moved[-1]) / _HELD
        rows.append(Row.info(name, "creep of a held can", rate, "um/s"))
    return ExperimentResult(rows, {"loops": table}, _draw(loops))


def judge(name: str, loop: Loop, without: Loop) -> list[Row]:
    """Judge a loop beside that without friction."""
    up, down = np.flatnonzero(np.isclose(loop.torque, _MIDDLE))
    rows = []
    for what, force in (("wire", loop.wire), ("pad", loop.pad)):
        gap = float(force[down] - force[up])
        quantity = f"{what} force, opening less closing, at {100 * _MIDDLE:g} %"
        if name == "none":
            row = Row.within(name, quantity, 0.0, gap, "N", absolute=1.0)
        elif what == "pad":
            row = Row.at_least(name, quantity, 0.1, gap, "N")
        else:
            row = Row.info(name, quantity, gap, "N")
        rows.append(row)
    rows += [
        Row.info(name, "pad force while closing", float(loop.pad[up]), "N"),
        Row.info(name, "wire force after power is lost", loop.left, "N"),
        Row.info(name, "base opens by", float(np.rad2deg(loop.opened)), "degrees"),
    ]
    if name != "none":
        most = float(np.max(without.pad) * 1.01)
        rows.append(
            Row.at_most(name, "largest pad force", most, float(np.max(loop.pad)), "N")
        )
    return rows


def _draw(loops: dict[str, Loop]) -> Any:
    figure = make_figure(8.0, 3.6, "Tightening and relaxing a grip")
    panels = figure.subplots(1, 2)
    for axes, field, label in zip(
        panels,
        ("wire", "pad"),
        ("force of each wire [N]", "force of each finger [N]"),
        strict=True,
    ):
        style_axes(axes, xlabel="torque of the motor [% of full]", ylabel=label)
        for (name, loop), color in zip(loops.items(), COLORS, strict=False):
            axes.plot(
                100 * loop.torque,
                getattr(loop, field),
                marker=".",
                color=color,
                label=name,
            )
        axes.set_ylim(0.0)
    axes.legend(fontsize=8, frameon=False)
    return figure
