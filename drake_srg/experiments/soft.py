"""A sponge of finite elements, grasped, lifted and held: gently and strongly.

The gripper closes on a block of foam that stands on the table, with a small and a large
pull at its wires. What squeeze and force must be follows from the foam's elasticity and
from the wires' moments about the base hinges.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping
from typing import Any

import numpy as np

from drake_srg.common.srg_geometry import SRG
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.experiments.sponge import (
    CLEARANCE,
    CLOSE,
    FOAM,
    HOLD,
    LIFT,
    LIFT_HEIGHT,
    SIZE,
    TIME_STEP,
    Case,
    Grasp,
    grasp,
)
from drake_srg.recording.figure import make_figure, style_axes

# Of each wire [N]: near the least that closes the hand within `CLOSE`, and what the
# driver gives unless told otherwise.
COMMANDS = {"gentle": 45.0, "strong": 103.0}
# Thereafter the strong one pulls harder and harder, up to all that the servo gives [s].
RAMP = 8.0
# Half the step, and a finer mesh, of 4 x 6 x 4 cells, must not change the squeeze by
# more than this share.
FINE, LARGEST_CHANGE = 0.0113, 0.1  # m
# As for rigid objects, held is what moves less than this in the hand [m].
MOST_CREEP = 0.005


def run(track: Track) -> ExperimentResult:
    """Grasp with both commands, again with half the step and a finer mesh, and ramp."""
    strong = Case(COMMANDS["strong"])
    cases: dict[str, tuple[Case, dict[str, Any]]] = {
        **{n: (Case(f), {"picture": True}) for n, f in COMMANDS.items()},
        "half the step": (dc.replace(strong, time_step=TIME_STEP / 2.0), {}),
        "finer mesh": (dc.replace(strong, resolution=FINE), {}),
        "harder and harder": (strong, {"hold": 1.0, "ramp": RAMP}),
    }
    grasps = {n: grasp(cases[n][0], **cases[n][1]) for n in track(list(cases))}
    tables = {
        name.replace(" ", "_"): {
            "time [s]": result.time,
            "squeeze": result.squeeze,
            "grip force [N]": result.force,
            "wire force [N]": result.wire_force,
            "moved in the hand [m]": result.moved,
        }
        for name, result in grasps.items()
    }
    return ExperimentResult(judge(grasps), tables, draw(grasps))


def judge(grasps: Mapping[str, Grasp]) -> list[Row]:
    """Compare what came of the grasps with elasticity, statics and each other."""
    rows: list[Row] = []
    for name in COMMANDS:
        rows += _judge_hold(name, grasps[name])
        rows += _judge_squeeze(name, grasps[name])
    squeeze = {n: g.at_rest(g.squeeze) for n, g in grasps.items()}
    more = squeeze["strong"] - squeeze["gentle"]
    rows.append(Row.at_least("strong - gentle", "squeeze", 0.1, more, "of the width"))
    for name in ("half the step", "finer mesh"):
        rows += [
            Row.within(
                name,
                "squeeze, as before",
                squeeze["strong"],
                squeeze[name],
                "of the width",
                relative=LARGEST_CHANGE,
            ),
            *_judge_hold(name, grasps[name]),
        ]
    return [*rows, *_tell_ramp("harder and harder", grasps["harder and harder"])]


def _tell_ramp(name: str, ramp: Grasp) -> list[Row]:
    after = ramp.time > CLOSE + LIFT
    out = ramp.moved[after] > MOST_CREEP
    until = slice(int(np.argmax(out)) if out.any() else None)
    word = "squeezed out" if out.any() else "still held"
    return [
        Row.info(name, f"{word} at {quantity}", float(values[after][until].max()), unit)
        for quantity, values, unit in (
            ("a grip force of", ramp.force, "N"),
            ("a wire force of", ramp.wire_force, "N"),
            ("a squeeze of", ramp.squeeze, "of the width"),
        )
    ]


def _judge_hold(name: str, held: Grasp) -> list[Row]:
    after = held.time >= CLOSE + LIFT - 1e-9
    lost = np.flatnonzero(held.moved[after] > MOST_CREEP)
    held_for = held.time[after][lost[0]] - CLOSE - LIFT if len(lost) else HOLD
    if held.touched != {"gripper"}:
        held_for = 0.0
    last = held.time > CLOSE + LIFT + HOLD - 1.0
    creep = float(np.ptp(held.moved[last]) / np.ptp(held.time[last]))
    lifted = LIFT_HEIGHT - MOST_CREEP
    return [
        Row.at_least(
            name, "lifted off the table by", lifted * 1e3, held.lifted * 1e3, "mm"
        ),
        Row.at_least(name, "held for", HOLD, held_for, "s"),
        Row.at_most(name, "creep in the last second", 0.1, creep * 1e3, "mm/s"),
        Row.at_least(
            name, "least volume of an element", 0.0, held.least_volume, "of its own"
        ),
    ]


def _judge_squeeze(name: str, held: Grasp) -> list[Row]:
    """Bounds by the theorems of minimum energy, of a linear elastic block.

    It is at least as stiff as the column between the pads alone, free to bulge, and at
    most as if all of it were squeezed as much and could not bulge at all.
    """
    e, nu = FOAM.youngs_modulus, FOAM.poissons_ratio
    confined = e * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))
    squeeze, force = held.at_rest(held.squeeze), held.at_rest(held.force)
    column = e * SRG.pad_width * (SIZE[2] - CLEARANCE)
    return [
        Row.at_most(
            name,
            "squeeze, at most F / (E A_pad)",
            force / column,
            squeeze,
            "of the width",
        ),
        Row.at_least(
            name,
            "squeeze, at least F / (M A_side)",
            force / (confined * SIZE[0] * SIZE[2]),
            squeeze,
            "of the width",
        ),
        Row.within(
            name,
            "squeeze, about F / (E A_side)",
            force / (e * SIZE[0] * SIZE[2]),
            squeeze,
            "of the width",
            relative=0.2,
        ),
        # The foam may press up to a tenth of the lever off the pads' middles.
        Row.within(
            name,
            "grip force, from the wires'",
            held.expected_force,
            force,
            "N",
            relative=0.1,
        ),
    ]


def draw(grasps: Mapping[str, Grasp]) -> Any:
    """Draw force and squeeze over time beside pictures of the held sponge."""
    figure = make_figure(11.0, 4.6, "A sponge, grasped gently and strongly")
    left, *columns = figure.subfigures(1, 3, width_ratios=[1.7, 1.0, 1.0])
    force, squeeze = left.subplots(2, 1, sharex=True)
    style_axes(force, ylabel="grip force [N]")
    style_axes(squeeze, xlabel="time [s]", ylabel="squeeze [% of the width]")
    for name in (*COMMANDS, "half the step", "finer mesh"):
        result = grasps[name]
        style = {"lw": 1.6 if name in COMMANDS else 1.0, "label": name}
        style["ls"] = "-" if name in COMMANDS else (0, (4, 3))
        force.plot(result.time, result.force, **style)
        squeeze.plot(result.time, 100.0 * np.maximum(result.squeeze, 0.0), **style)
    for axes in (force, squeeze):
        axes.axvspan(CLOSE, CLOSE + LIFT, color="#eef1f4", zorder=0)
    force.annotate("lift", (CLOSE + 0.1, 0.5), fontsize=8)
    squeeze.legend(fontsize=8, frameon=False, loc=(0.72, 0.5))
    for column, name in zip(columns, COMMANDS, strict=True):
        axes = column.subplots()
        axes.axis("off")
        axes.set_title(f"{name}: {COMMANDS[name]:.0f} N each wire", fontsize=9)
        if grasps[name].picture is not None:
            axes.imshow(grasps[name].picture)
    return figure
