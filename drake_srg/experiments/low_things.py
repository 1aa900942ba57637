"""A lying squeeze bottle between tips that stay straight and tips that curl.

The bottle is 94 mm wide and 58 mm high, so only the tips touch it. The hand takes it at
some distance from its middle, lifts it and shakes it with half of g. It counts as held
if it touches nothing but the hand in the end; it may hang.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.common.schema import Rotation, Transform

from drake_srg.experiments.data import household_objects
from drake_srg.experiments.grasp_width_cases import Grasp, Thing, grasp
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.planning.grasps.srg_hand import SrgFingers
from drake_srg.recording.timeline import COLORS, make_figure, style_axes

# Its greatest width and height as it lies, and the middle of its mass above its bottom
# (squeeze_bottle.sdf) [m].
_WIDTH, _HEIGHT, _MIDDLE = 0.094, 0.058, 0.0704
# Where the hand is on the bench (gripper_bench.yaml), and how far the ends of its
# fingers stay above the table [m].
_BENCH_X, _GAP = 0.5, 0.012
STRAIGHT, CURLED, WIRES = "Algorithm 1", "tips that curl", "wires"
HALF = f"{CURLED}, half the step"
_POSITION = (
    "gripper=!SrgPositionDriver {{underactuation: "
    "{{base: freeze, approach_speed: 1.0, tip: {tip}}}}}"
)
_CURL = _POSITION.format(tip="curl")
HANDS: Mapping[str, Sequence[str]] = {
    STRAIGHT: (_POSITION.format(tip="algorithm_1"),),
    CURLED: (_CURL,),
    HALF: (_CURL, "plant_config.time_step=0.001"),
    # With the springs of `clear_table_tendon`.
    WIRES: (
        "gripper=!SrgTendonDriver {drive: "
        "{base_spring: {preload: 0.03}, tip_spring: {preload: 0.05}}}",
    ),
}
# Tips that curl hold at least this share.
LEAST = 0.85
Case = tuple[str, float]


def run(
    track: Track,
    *,
    offsets: Sequence[float] = (
        -0.04,
        -0.03,
        -0.02,
        -0.01,
        0.0,
        0.01,
        0.02,
        0.03,
        0.04,
    ),
) -> ExperimentResult:
    """Take the bottle with every hand at every distance from its middle.

    Args:
        track: Shows progress.
        offsets: From the middle of its mass, towards the nozzle [m].
    """
    cases = [(hand, offset) for hand in HANDS for offset in offsets]
    passing = track(cases, label=lambda c: f"{c[0]}, {1e3 * c[1]:.0f} mm")
    return make_result({c: grasp(lying_bottle(*c)) for c in passing})


def lying_bottle(hand: str, offset: float) -> Thing:
    """Return the bottle below a hand, which closes across it.

    Args:
        hand: One of `HANDS`.
        offset: See `run`.
    """
    bottle = household_objects()["squeeze_bottle"]
    bottle.pose = Transform()
    bottle.pose.translation = [_BENCH_X - _MIDDLE - offset, 0.0, 0.5 * _HEIGHT]
    bottle.pose.rotation = Rotation(value=Rotation.Rpy(deg=[90.0, 0.0, 90.0]))
    fingers = SrgFingers()
    return Thing(
        f"{1e3 * offset:.0f} mm",
        offset,
        bottle,
        fingers.deepest + _GAP,
        1.0 if hand == WIRES else fingers.closed(_WIDTH).closure,
        HANDS[hand],
    )


def make_result(grasps: Mapping[Case, Grasp]) -> ExperimentResult:
    """Judge grasps by hand and distance."""
    columns: dict[str, list[Any]] = {
        "hand": [hand for hand, _ in grasps],
        "offset [m]": [offset for _, offset in grasps],
        "held": [int(g.free) for g in grasps.values()],
        "base, closed [rad]": [float(g.closed[0]) for g in grasps.values()],
        "tip, closed [rad]": [float(g.closed[1]) for g in grasps.values()],
    }
    return ExperimentResult(judge(grasps), {"grasps": columns}, draw(grasps))


def judge(grasps: Mapping[Case, Grasp]) -> list[Row]:
    """Expect that tips that curl hold the bottle with their pads upright."""
    rows = []
    for name in HANDS:
        own = [g for (hand, _), g in grasps.items() if hand == name]
        share = float(np.mean([g.free for g in own]))
        lean = np.rad2deg(0.5 * np.pi - float(np.median([g.closed.sum() for g in own])))
        if name in (CURLED, HALF):
            rows.append(Row.at_least(name, "share held", LEAST, share, "", spread=0.15))
        else:
            rows.append(Row.info(name, "share held", share, "", spread=0.15))
        rows.append(Row.info(name, "pads lean outwards, median", lean, "deg"))
    return rows


def draw(grasps: Mapping[Case, Grasp]) -> Any:
    """Draw which grasps held, by hand and distance."""
    figure = make_figure(8.0, 3.0, "A lying squeeze bottle, lifted and shaken")
    axes = figure.subplots()
    style_axes(axes, xlabel="grasp to the middle of its mass, towards the nozzle [mm]")
    rows = {name: -k for k, name in enumerate(HANDS)}
    for free, label, color, marker in (
        (True, "held", COLORS[2], "o"),
        (False, "lost", COLORS[1], "x"),
    ):
        found = [c for c, g in grasps.items() if g.free == free]
        x, y = [1e3 * offset for _, offset in found], [rows[hand] for hand, _ in found]
        axes.plot(x, y, marker, color=color, label=label)
    axes.set_yticks(list(rows.values()), list(rows), fontsize=8)
    axes.set_ylim(-len(rows) + 0.5, 0.5)
    axes.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure
