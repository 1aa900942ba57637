"""A finite-element sponge, grasped, lifted and held with a gentle and a strong pull.

The gripper closes on a block of foam that stands on the table, with a small and a large
wire force. The foam's elasticity and the wires' moments about the base hinges determine
the expected squeeze and grip force.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping
from typing import Any

import numpy as np

from drake_srg.common.srg_geometry import SRG
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
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
from drake_srg.recording.timeline import make_figure, style_axes

PULLS = ("gentle", "strong")
# Duration of the ramp of the strong pull up to the servo's limit, after the hold [s].
RAMP = 8.0
# Half the time step, or a finer mesh of 4 x 6 x 4 cells, may change the squeeze by this
# share at most.
FINE, LARGEST_CHANGE = 0.0113, 0.1  # m, relative
# The sponge counts as held while it moves less than this in the hand, like rigid
# objects [m].
MOST_CREEP = 0.005


def run(
    track: Track, *, gentle: float = 45.0, strong: float = 103.0
) -> ExperimentResult:
    """Grasp with both pulls, with half the time step and a finer mesh, and with a ramp.

    Args:
        track: Shows progress.
        gentle: Force of each wire [N]; 45 N is just enough to close the hand in time.
        strong: Force of each wire [N]; 103 N is the driver's default.
    """
    firm = Case(strong)
    cases: dict[str, tuple[Case, dict[str, Any]]] = {
        "gentle": (Case(gentle), {"picture": True}),
        "strong": (firm, {"picture": True}),
        "half the step": (dc.replace(firm, time_step=TIME_STEP / 2.0), {}),
        "finer mesh": (dc.replace(firm, resolution=FINE), {}),
        "ramp": (firm, {"hold": 1.0, "ramp": RAMP}),
    }
    grasps = {n: grasp(cases[n][0], **cases[n][1]) for n in track(list(cases))}
    tables = {
        name.replace(" ", "_"): {
            "time [s]": result.time,
            "squeeze": result.squeeze,
            "grip force [N]": result.force,
            "wire force [N]": result.wire_force,
            "motion in the hand [m]": result.moved,
        }
        for name, result in grasps.items()
    }
    pulls = dict(zip(PULLS, (gentle, strong), strict=True))
    return ExperimentResult(judge(grasps), tables, draw(grasps, pulls))


def judge(grasps: Mapping[str, Grasp]) -> list[Row]:
    """Compare the grasps with elasticity, statics and each other."""
    rows: list[Row] = []
    for name in PULLS:
        rows += _judge_hold(name, grasps[name])
        rows += _judge_squeeze(name, grasps[name])
    squeeze = {n: g.at_rest(g.squeeze) for n, g in grasps.items()}
    more = squeeze["strong"] - squeeze["gentle"]
    rows.append(Row.at_least("strong - gentle", "squeeze", 0.1, more, "of the width"))
    for name in ("half the step", "finer mesh"):
        rows += [
            Row.within(
                name,
                "squeeze, same as strong",
                squeeze["strong"],
                squeeze[name],
                "of the width",
                relative=LARGEST_CHANGE,
            ),
            *_judge_hold(name, grasps[name]),
        ]
    return [*rows, *describe_ramp("ramp", grasps["ramp"])]


def describe_ramp(name: str, ramp: Grasp) -> list[Row]:
    """Return the forces and the squeeze at which a ramp squeezes the sponge out."""
    after = ramp.time > CLOSE + LIFT
    out = ramp.moved[after] > MOST_CREEP
    until = slice(int(np.argmax(out)) if out.any() else None)
    word = "when squeezed out" if out.any() else "while still held"
    return [
        Row.info(name, f"{quantity} {word}", float(values[after][until].max()), unit)
        for quantity, values, unit in (
            ("grip force", ramp.force, "N"),
            ("wire force", ramp.wire_force, "N"),
            ("squeeze", ramp.squeeze, "of the width"),
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
            name,
            "smallest volume of an element",
            0.0,
            held.least_volume,
            "of its free volume",
        ),
    ]


def _judge_squeeze(name: str, held: Grasp) -> list[Row]:
    """Judge the squeeze by energy bounds of a linear elastic block.

    The block is at least as stiff as the column between the pads alone, free to bulge.
    It is at most as stiff as if it were squeezed uniformly and could not bulge.
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
        # The foam may press off the pads' middles by a tenth of the lever.
        Row.within(
            name,
            "grip force, from the wire force",
            held.expected_force,
            force,
            "N",
            relative=0.1,
        ),
    ]


def draw(grasps: Mapping[str, Grasp], pulls: Mapping[str, float]) -> Any:
    """Draw force and squeeze over time beside pictures of the held sponge.

    Args:
        grasps: By the name of the case.
        pulls: Force of each wire by the name of the pull [N].
    """
    figure = make_figure(11.0, 4.6, "A sponge under a gentle and a strong pull")
    left, *columns = figure.subfigures(1, 3, width_ratios=[1.7, 1.0, 1.0])
    force, squeeze = left.subplots(2, 1, sharex=True)
    style_axes(force, ylabel="grip force [N]")
    style_axes(squeeze, xlabel="time [s]", ylabel="squeeze [% of the width]")
    for name in (*PULLS, "half the step", "finer mesh"):
        result = grasps[name]
        style = {"lw": 1.6 if name in PULLS else 1.0, "label": name}
        style["ls"] = "-" if name in PULLS else (0, (4, 3))
        force.plot(result.time, result.force, **style)
        squeeze.plot(result.time, 100.0 * np.maximum(result.squeeze, 0.0), **style)
    for axes in (force, squeeze):
        axes.axvspan(CLOSE, CLOSE + LIFT, color="#eef1f4", zorder=0)
    force.annotate("lift", (CLOSE + 0.1, 0.5), fontsize=8)
    squeeze.legend(fontsize=8, frameon=False, loc=(0.72, 0.5))
    for column, name in zip(columns, PULLS, strict=True):
        axes = column.subplots()
        axes.axis("off")
        axes.set_title(f"{name}: {pulls[name]:.0f} N per wire", fontsize=9)
        if grasps[name].picture is not None:
            axes.imshow(grasps[name].picture)
    return figure
