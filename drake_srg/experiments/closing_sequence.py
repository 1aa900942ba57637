"""A hand closing around a can: joint angles, wire force, proximity and touch over time.

The hand closes once with wires, where contact stops the base and the tip follows, and
twice with Algorithm 1, which switches from base to tip when a sensor fires: proximity
or touch.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from drake_srg.common.srg_geometry import SRG
from drake_srg.experiments.closing import (
    LOG_PERIOD,
    NEAR,
    START,
    TOUCHED,
    can_in_hand,
    first,
    shifts,
)
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.gripper.underactuation import FINGERS, JOINT_NAMES
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.simulation.rig import Rig
from drake_srg.types import Vector

DRIVERS = {
    "wires": "!SrgTendonDriver {}",
    "Algorithm 1, proximity": "!SrgPositionDriver {trigger: proximity}",
    "Algorithm 1, touch": "!SrgPositionDriver {trigger: touch}",
}
DURATION = 2.9  # of closing [s]
_COUNT = 2.0 * np.pi / 4096.0  # of a 12-bit encoder: less is no motion [rad]
# Largest difference of a joint between the fingers. They are identical, but the meshes
# of pads and can are not mirrored.
_SYMMETRY = np.deg2rad(0.5)
# From a hinge to the point where its link presses: middle of base link, of pad [m].
_BASE_LEVER, _TIP_LEVER = 0.5 * SRG.base_length, round(SRG.pad_middle, 3)


@dc.dataclass(frozen=True)
class ClosingSequence:
    """Measurements of a closing hand; joints and sensors in order of `JOINT_NAMES`.

    Attributes:
        time: Since the command to close, shape (K,) [s].
        angle: Of the joints, shape (K, 4) [rad].
        proximity: Signed distances, shape (K, 4) [m].
        touch: Forces on the closing sides, shape (K, 4) [N].
        wire_force: Shape (K, 2) [N]; None without wires.
        wire_limit: Largest force of a wire at the servo's force limit [N].
        shift: Motion of the can on the table, shape (K,) [m].
    """

    time: Vector
    angle: Vector
    proximity: Vector
    touch: Vector
    shift: Vector
    wire_force: Vector | None = None
    wire_limit: float = np.nan

    def first(self, condition: npt.NDArray[np.bool_]) -> float:
        """Return when a condition (K,) first holds [s]; NaN if it never does."""
        return first(self.time, condition)


def close(driver: str, duration: float = DURATION) -> ClosingSequence:
    """Close a hand around the can, for a duration [s]."""
    scenario = can_in_hand(driver)
    with Rig(scenario, name="closing_sequence", log_period=LOG_PERIOD) as rig:
        rig.advance(START)
        rig.advance(duration, closure=1.0)
        log = rig.log()
    gripper, wires = scenario.gripper, None
    limit = np.nan
    if gripper is not None and gripper.wire_motor is not None:
        wires = log["gripper.wire_force"]
        full = gripper.wire_motor.drive.full_wire_force
        limit = gripper.servo.force_limit * full
    return ClosingSequence(
        time=log["time"] - START,
        angle=log["gripper.state_measured"][:, :4],
        proximity=log["gripper.proximity"],
        touch=log["gripper.contact_force"],
        shift=shifts(log),
        wire_force=wires,
        wire_limit=limit,
    )


def run(track: Track) -> ExperimentResult:
    """Close with every driver."""
    sequences = {name: close(DRIVERS[name]) for name in track(list(DRIVERS))}
    rows = [row for name, s in sequences.items() for row in judge(name, s)]
    rows += judge_agreement(sequences)
    tables = {
        name.lower().replace(",", "").replace(" ", "_"): _columns(s)
        for name, s in sequences.items()
    }
    return ExperimentResult(rows, tables, draw(sequences))


def judge(name: str, s: ClosingSequence) -> list[Row]:
    """Judge the order of events at both fingers, and the grip at the end."""
    rows = []
    for side, (base, tip) in zip(("left", "right"), FINGERS, strict=True):
        near = s.first(s.proximity[:, base] <= NEAR)
        base_touch = s.first(s.touch[:, base] >= TOUCHED)
        tip_start = s.first(s.angle[:, tip] > _COUNT)
        tip_touch = s.first(s.touch[:, tip] >= TOUCHED)
        # With proximity, Algorithm 1 switches before the base touches the can.
        cue, what = base_touch, "touches"
        if "proximity" in name:
            cue, what = near, "is near"
        case = f"{name}, {side}"
        rows += [
            Row.info(case, "base touches at", base_touch, "s"),
            Row.at_least(
                case, f"tip starts after the base {what}", cue, tip_start, "s"
            ),
            Row.at_least(
                case, "tip touches after the base", base_touch, tip_touch, "s"
            ),
        ]
    last = s.touch[-1]
    left, right = (list(finger) for finger in FINGERS)
    off = float(np.max(np.abs(s.angle[:, left] - s.angle[:, right])))
    rows += [
        Row.at_least(
            name, "smallest touch force at the end", TOUCHED, float(min(last)), "N"
        ),
        Row.at_most(
            name,
            "largest difference of left and right joints",
            np.rad2deg(_SYMMETRY),
            np.rad2deg(off),
            "degrees",
        ),
        Row.info(name, "base touch force at the end", float(np.mean(last[:2])), "N"),
        Row.info(name, "tip touch force at the end", float(np.mean(last[2:])), "N"),
        Row.info(name, "motion of the can", 1e3 * float(s.shift[-1]), "mm"),
    ]
    if s.wire_force is not None:
        most = float(np.max(s.wire_force))
        rows += [
            Row.at_most(name, "largest wire force", s.wire_limit, most, "N"),
            Row.within(
                name,
                "wire force at the end",
                s.wire_limit,
                float(np.mean(s.wire_force[-1])),
                "N",
                relative=0.05,
            ),
        ]
    return rows


def judge_agreement(sequences: Mapping[str, ClosingSequence]) -> list[Row]:
    """Expect all drivers to wrap the can in the same posture.

    The can stops every link, whatever drives it. Only the depth differs to which links
    press into can or rubber, which the proximity sensors measure.
    """
    wires, *others = sequences.items()
    rows = []
    for name, s in others:
        off = np.rad2deg(np.abs(s.angle[-1] - wires[1].angle[-1]))
        depth = -np.minimum(np.minimum(s.proximity[-1], wires[1].proximity[-1]), 0.0)
        bases, tips = np.array(FINGERS).T
        base_limit = np.rad2deg(np.max(depth[bases]) / _BASE_LEVER)
        # The tip's angle is relative to the base link, so the base's error adds to it.
        tip_limit = base_limit + np.rad2deg(np.max(depth[tips]) / _TIP_LEVER)
        for link, joints, limit in (
            ("base", bases, base_limit),
            ("tip", tips, tip_limit),
        ):
            quantity = f"{link} at the end, difference from {wires[0]}"
            measured = float(np.max(off[joints]))
            rows.append(Row.at_most(name, quantity, limit, measured, "degrees"))
    return rows


def _columns(s: ClosingSequence) -> dict[str, Vector]:
    """Return every fifth sample: a row per 10 ms, the period of the sensors."""
    columns: dict[str, Vector] = {"time [s]": s.time[::5]}
    for i, name in enumerate(JOINT_NAMES):
        columns[f"{name}: angle [rad]"] = s.angle[::5, i]
        columns[f"{name}: proximity [m]"] = s.proximity[::5, i]
        columns[f"{name}: touch [N]"] = s.touch[::5, i]
    if s.wire_force is not None:
        for i, side in enumerate(("left", "right")):
            columns[f"{side}: wire force [N]"] = s.wire_force[::5, i]
    columns["motion of the can [m]"] = s.shift[::5]
    return columns


def draw(sequences: Mapping[str, ClosingSequence]) -> Any:
    """Draw angle, wire force, proximity and touch over time, a column per driver."""
    figure = make_figure(11.0, 8.0, "Closing around a can")
    shape = (4, len(sequences))
    all_axes = figure.subplots(*shape, sharex=True, sharey="row", squeeze=False)
    labels = ("angle [rad]", "proximity [mm]", "touch [N]", "wire force [N]")
    for k, (name, s) in enumerate(sequences.items()):
        for i, (axes, label) in enumerate(zip(all_axes[:, k], labels, strict=True)):
            style_axes(
                axes,
                xlabel="time since the command [s]" if i == 3 else "",
                ylabel=label if k == 0 else "",
            )
        all_axes[0, k].set_xlim(0.0, s.time[-1])
        all_axes[0, k].set_title(name, fontsize=9, loc="left")
        for axes, values in zip(
            all_axes[:3, k], (s.angle, 1e3 * s.proximity, s.touch), strict=True
        ):
            for joint, color in enumerate(COLORS[:2]):
                for finger, style in zip(FINGERS, ("-", (0, (2, 2))), strict=True):
                    link, side = ("base", "tip")[joint], ("left", "right")[finger[0]]
                    axes.plot(
                        s.time,
                        values[:, finger[joint]],
                        color=color,
                        ls=style,
                        lw=1.3,
                        label=f"{link}, {side}",
                    )
                start = s.first(s.touch[:, FINGERS[0][joint]] >= TOUCHED)
                axes.axvline(start, color=color, lw=0.8, alpha=0.5)
        axes = all_axes[3, k]
        if s.wire_force is None:
            axes.text(0.5, 0.5, "no wires", transform=axes.transAxes, ha="center")
            continue
        for force, style in zip(s.wire_force.T, ("-", (0, (2, 2))), strict=True):
            axes.plot(s.time, force, color=COLORS[2], ls=style, lw=1.3)
        axes.axhline(s.wire_limit, color=COLORS[-1], lw=0.8, ls="--")
        axes.annotate(
            "servo limit",
            (0.0, s.wire_limit),
            xytext=(4, -10),
            textcoords="offset points",
            fontsize=7,
        )
    all_axes[0, 0].legend(fontsize=8, frameon=False)
    figure.align_ylabels(all_axes[:, 0])
    return figure
