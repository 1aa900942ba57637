"""The widest box that the hand closes on, and the thinnest sheets and rods it holds.

The hand comes from above, closes on an object that stands on the table, lifts it and
shakes it gently. The object counts as held if at the end it touches only the gripper
and has not moved in it. Flat boxes are wrapped as `clear_table` does it, with the palm
at the right height, too low and too high.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.common.srg_geometry import SRG
from drake_srg.experiments.grasp_width_cases import (
    HEIGHT,
    MOST_SLIP,
    Grasp,
    box,
    flat_box,
    grasp,
    rod,
    sheet,
)
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.types import Vector

CLAIM = 0.145  # figure of the SRG thesis [m]


def run(
    track: Track,
    *,
    boxes: Sequence[float] = (
        0.05,
        0.07,
        0.09,
        0.11,
        0.13,
        0.145,
        0.16,
        0.17,
        0.18,
        0.19,
    ),
    sheets: Sequence[float] = (0.00076, 0.0003),
    rods: Sequence[float] = (0.0072, 0.003, 0.001),
    flat: Sequence[float] = (0.132, 0.145, 0.158, 0.165),
    gaps: Sequence[float] = (-0.001, 0.006, 0.01),
) -> ExperimentResult:
    """Grasp boxes from narrow to wide, then thin objects, then flat boxes.

    Args:
        track: Shows progress.
        boxes: Width of each box [m].
        sheets: Thickness of each sheet [m]; a bank card first.
        rods: Diameter of each rod [m]; a pencil first.
        flat: Width of each flat box [m].
        gaps: Between the base links and the top of each flat box [m].
    """
    things = [*map(box, sorted(boxes)), *map(sheet, sheets), *map(rod, rods)]
    things += [flat_box(width, gap) for width in flat for gap in gaps]
    passing = track(things, label=lambda t: t.name)
    return make_result({t.name: (t.size, grasp(t)) for t in passing})


def make_result(grasps: Mapping[str, tuple[float, Grasp]]) -> ExperimentResult:
    """Judge grasps.

    Args:
        grasps: Size of the object [m] and outcome, by name; boxes from narrow to wide.
    """
    columns: dict[str, list[Any]] = {
        "object": list(grasps),
        "size [m]": [size for size, _ in grasps.values()],
        "held": [int(g.held) for _, g in grasps.values()],
        "raised [m]": [g.raised for _, g in grasps.values()],
        "slip [m]": [g.slip for _, g in grasps.values()],
    }
    for word in ("closed", "lifted"):
        for i, joint in enumerate(("base", "tip")):
            columns[f"{joint}, {word} [rad]"] = [
                float(getattr(g, word)[i]) for _, g in grasps.values()
            ]
    return ExperimentResult(judge(grasps), {"grasps": columns}, draw(grasps))


def judge(grasps: Mapping[str, tuple[float, Grasp]]) -> list[Row]:
    """Judge the widest box, every thin object and every flat box."""
    widest = 0.0
    boxes = {name: g for name, g in grasps.items() if name.startswith("box")}
    for width, result in boxes.values():
        if not result.held:
            break
        widest = width
    rows = [
        Row.at_least("boxes", "widest box held", 1e3 * CLAIM, 1e3 * widest, "mm"),
        Row.within(
            "hand",
            "gap between parallel pads, bases open",
            1e3 * CLAIM,
            1e3 * SRG.parallel_gap,
            "mm",
            relative=0.01,
        ),
    ]
    for name, (size, result) in grasps.items():
        if name not in boxes or size <= CLAIM:
            slip = 1e3 * result.slip
            rows += [
                Row.at_least(name, "free of its support", 1.0, float(result.free), ""),
                Row.at_most(name, "slip while shaken", 1e3 * MOST_SLIP, slip, "mm"),
            ]
        if name in boxes:
            moved = 1e3 * result.moved
            rows.append(Row.info(name, "motion out of the hand", moved, "mm"))
    return rows


def draw(grasps: Mapping[str, tuple[float, Grasp]]) -> Any:
    """Draw the hand on two boxes, motion of boxes, and slip of everything else."""
    boxes = {n: g for n, g in grasps.items() if n.startswith("box")}
    others = {n: g for n, g in grasps.items() if n not in boxes}
    figure = make_figure(11.0, 8.0, "Widest boxes and thinnest objects")
    (first, second), (moved, slips) = figure.subplots(2, 2, height_ratios=[1.3, 1])
    claimed = min(boxes, key=lambda name: abs(boxes[name][0] - CLAIM))
    held = [name for name in boxes if boxes[name][1].held]
    for axes, name in ((first, claimed), (second, held[-1] if held else claimed)):
        _sketch(axes, *boxes[name])
        axes.set_title(f"{name}: closed (dashed) and lifted", fontsize=9, loc="left")
    style_axes(
        moved, xlabel="width of the box [mm]", ylabel="motion out of the hand [mm]"
    )
    for word, color, marker in (("held", COLORS[2], "o"), ("lost", COLORS[1], "x")):
        points = [
            (1e3 * width, 1e3 * g.moved)
            for width, g in boxes.values()
            if g.held == (word == "held")
        ]
        if points:
            moved.plot(*zip(*points, strict=True), marker, color=color, label=word)
    moved.axvline(1e3 * CLAIM, color=COLORS[-1], lw=0.8, ls=":", label="claim")
    moved.set_title("Boxes during the lift", fontsize=9, loc="left")
    moved.legend(fontsize=8, frameon=False)
    style_axes(slips, xlabel="slip while shaken [mm]")
    slips.grid(False)
    colors = [COLORS[2] if g.held else COLORS[1] for _, g in others.values()]
    slips.barh(list(others), [1e3 * g.slip for _, g in others.values()], color=colors)
    slips.axvline(1e3 * MOST_SLIP, color=COLORS[-1], lw=0.8, ls="--")
    slips.set_xscale("log")
    slips.set_title(
        "Thin objects and flat boxes; dashed: limit", fontsize=9, loc="left"
    )
    return figure


def _sketch(axes: Any, width: float, result: Grasp) -> None:
    """Draw the hand, pointing down, and a box: closed and lifted."""
    for k, (angles, top, color) in enumerate(
        zip(
            (result.closed, result.lifted),
            result.top,
            (COLORS[5], COLORS[0]),
            strict=True,
        )
    ):
        dashed = (0, (3, 2)) if k == 0 else "-"
        y, bottom = 0.5 * width, top + HEIGHT
        corners = np.array([(-y, bottom), (-y, top), (y, top), (y, bottom)])
        axes.plot(*(1e3 * corners.T), color=COLORS[4], ls=dashed, lw=1.2)
        base, tip = angles
        hinge = np.array([SRG.hinge_y, SRG.hinge_x])
        tip_hinge = hinge + SRG.base_length * _direction(base)
        end = SRG.pad_end
        along, inwards = _direction(base + tip), _direction(base + tip + np.pi / 2)
        pad = tip_hinge + np.array(
            [
                distance * along + depth * inwards
                for distance, depth in (
                    (end - SRG.pad_length, 0.0),
                    (end - SRG.pad_length, SRG.face_offset),
                    (end, SRG.face_offset),
                    (end, 0.0),
                )
            ]
        )
        links = np.array([hinge, tip_hinge, tip_hinge + end * along])
        for side in (1.0, -1.0):
            mirror = 1e3 * np.array([side, 1.0])
            axes.plot(
                *(links * mirror).T, marker="o", color=color, ls=dashed, lw=2.0, ms=3
            )
            axes.fill(*(pad * mirror).T, color=color, alpha=0.35, lw=0.0)
    palm = 1e3 * np.array(
        [(-0.033, 0.04), (-0.033, 0.072), (0.033, 0.072), (0.033, 0.04)]
    )
    axes.plot(*palm.T, color=COLORS[-1], lw=1.2)
    axes.set_aspect("equal")
    axes.set_ylim(205.0, 40.0)
    axes.set_xlim(-150.0, 150.0)
    axes.set_axis_off()


def _direction(angle: float) -> Vector:
    """Return (y, x) of a link: open points to the side, closing turns it down."""
    return np.array([np.cos(angle), np.sin(angle)])
