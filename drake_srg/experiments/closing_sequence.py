"""A hand closes around a can: base and tip angles, wires, proximity and touch in time.

Once with wires, where contact stops the base and the tip follows, and with Algorithm 1,
which switches from base to tip when a sensor fires: proximity or touch.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from drake_srg.common.srg_geometry import SRG
from drake_srg.experiments.objects import household_objects
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.gripper.drivers import SrgTendonDriver
from drake_srg.gripper.proximity import ProximityConfig
from drake_srg.gripper.touch import TouchConfig
from drake_srg.gripper.underactuation import FINGERS, JOINT_NAMES
from drake_srg.recording.figure import COLORS, make_figure, style_axes
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Vector

DRIVERS = {
    "wires": "!SrgTendonDriver {}",
    "Algorithm 1, proximity": "!SrgPositionDriver {trigger: proximity}",
    "Algorithm 1, touch": "!SrgPositionDriver {trigger: touch}",
}
CAN = "005_tomato_soup_can"
# The palm points to the front, its middle over the table by this [m].
_HEIGHT = 0.06
# The can's middle in the palm frame: 4 mm from the palm's face (at 72 mm), its radius
# is 34 mm. 2 mm closer, and the open hand's base sensors fire from the start [m].
_X = SRG.palm_face_x + 0.004 + 0.034
START, DURATION = 0.1, 2.9  # of closing, and how long it is watched [s]
_COUNT = 2.0 * np.pi / 4096.0  # of a 12-bit encoder, below which no joint moved [rad]
_TOUCHED = TouchConfig().trigger_force  # what thin-film sensors begin to read [N]
_NEAR = ProximityConfig().trigger_distance  # at which proximity sensors fire [m]
# Both fingers are the same; the meshes of pads and can are not mirrored. Their joints
# differ by less than half a degree.
_SYMMETRY = np.deg2rad(0.5)
# From a hinge to where its link presses: the middle of the base link, of the pad [m].
_BASE_LEVER, _TIP_LEVER = 0.5 * SRG.base_length, round(SRG.pad_middle, 3)


@dc.dataclass(frozen=True)
class Sequence:
    """What a closing hand senses; joints and sensors are ordered as `JOINT_NAMES`.

    Attributes:
        time: Since the command to close, shape (K,) [s].
        angle: Of the joints, shape (K, 4) [rad].
        proximity: Signed distances, shape (K, 4) [m].
        touch: Forces on the closing sides, shape (K, 4) [N].
        wire_force: Shape (K, 2) [N]; None: there are no wires.
        wire_limit: What the servo can pull with as it is limited [N].
        shift: Of the can on the table, shape (K,) [m].
    """

    time: Vector
    angle: Vector
    proximity: Vector
    touch: Vector
    shift: Vector
    wire_force: Vector | None = None
    wire_limit: float = np.nan

    def first(self, condition: npt.NDArray[np.bool_]) -> float:
        """When a condition of shape (K,) holds for the first time [s], else NaN."""
        return float(self.time[np.argmax(condition)]) if condition.any() else np.nan


def close(driver: str, duration: float = DURATION) -> Sequence:
    """Close a hand that the can stands in."""
    can = household_objects()[CAN]
    can.resolution = 0.005  # as in gripper_bench: what base links press depends on it
    scenario = bench_scenario(
        can,
        gripper_rpy=[0.0, 0.0, 0.0],
        home=[-_X, 0.0, _HEIGHT],
        overrides=[f"gripper={driver}"],
    )
    with Rig(scenario, name="closing_sequence", log_period=0.002) as rig:
        rig.advance(START)
        rig.advance(duration, closure=1.0)
        log = rig.log()
    gripper, wires = scenario.gripper, None
    limit = np.nan
    if isinstance(gripper, SrgTendonDriver):
        wires = log["gripper.wire_force"]
        limit = gripper.servo.force_limit * gripper.drive.full_wire_force
    p_WO = log["object_pose.thing"][:, :3]
    return Sequence(
        time=log["time"] - START,
        angle=log["gripper.state_measured"][:, :4],
        proximity=log["gripper.proximity"],
        touch=log["gripper.contact_force"],
        shift=np.linalg.norm(p_WO - p_WO[0], axis=1),
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


def judge(name: str, s: Sequence) -> list[Row]:
    """Judge the order of events at both fingers, and the grip at the end."""
    rows = []
    for side, (base, tip) in zip(("left", "right"), FINGERS, strict=True):
        near = s.first(s.proximity[:, base] <= _NEAR)
        base_touch = s.first(s.touch[:, base] >= _TOUCHED)
        tip_start = s.first(s.angle[:, tip] > _COUNT)
        tip_touch = s.first(s.touch[:, tip] >= _TOUCHED)
        # Sensed before it is felt, the can makes Algorithm 1 switch early.
        cue, what = base_touch, "touches"
        if "proximity" in name:
            cue, what = near, "is near"
        case = f"{name}, {side}"
        rows += [
            Row.info(case, "base touches after", base_touch, "s"),
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
        Row.at_least(name, "least touch at the end", _TOUCHED, float(min(last)), "N"),
        Row.at_most(
            name,
            "joints, left from right",
            np.rad2deg(_SYMMETRY),
            np.rad2deg(off),
            "degrees",
        ),
        Row.info(name, "base touch at the end", float(np.mean(last[:2])), "N"),
        Row.info(name, "tip touch at the end", float(np.mean(last[2:])), "N"),
        Row.info(name, "the can moves by", 1e3 * float(s.shift[-1]), "mm"),
    ]
    if s.wire_force is not None:
        most = float(np.max(s.wire_force))
        rows += [
            Row.at_most(name, "wire force", s.wire_limit, most, "N"),
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


def judge_agreement(sequences: Mapping[str, Sequence]) -> list[Row]:
    """Judge that all drivers wrap the can into the same posture.

    The can stops every link, wherever its torque comes from. What is left is how deep
    links are pressed into can or rubber, which their proximity sensors tell.
    """
    wires, *others = sequences.items()
    rows = []
    for name, s in others:
        off = np.rad2deg(np.abs(s.angle[-1] - wires[1].angle[-1]))
        depth = -np.minimum(np.minimum(s.proximity[-1], wires[1].proximity[-1]), 0.0)
        bases, tips = np.array(FINGERS).T
        base_limit = np.rad2deg(np.max(depth[bases]) / _BASE_LEVER)
        # Its angle is against the base link, whose own error counts, too.
        tip_limit = base_limit + np.rad2deg(np.max(depth[tips]) / _TIP_LEVER)
        for link, joints, limit in (
            ("base", bases, base_limit),
            ("tip", tips, tip_limit),
        ):
            quantity = f"{link} at the end, from that with {wires[0]}"
            measured = float(np.max(off[joints]))
            rows.append(Row.at_most(name, quantity, limit, measured, "degrees"))
    return rows


def _columns(s: Sequence) -> dict[str, Vector]:
    """Every fifth sample: a row every 10 ms, as often as the sensors are read."""
    columns: dict[str, Vector] = {"time [s]": s.time[::5]}
    for i, name in enumerate(JOINT_NAMES):
        columns[f"{name}: angle [rad]"] = s.angle[::5, i]
        columns[f"{name}: proximity [m]"] = s.proximity[::5, i]
        columns[f"{name}: touch [N]"] = s.touch[::5, i]
    if s.wire_force is not None:
        for i, side in enumerate(("left", "right")):
            columns[f"{side}: wire force [N]"] = s.wire_force[::5, i]
    columns["the can moved by [m]"] = s.shift[::5]
    return columns


def draw(sequences: Mapping[str, Sequence]) -> Any:
    """Draw angle, wire force, proximity and touch over time, a column each driver."""
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
                start = s.first(s.touch[:, FINGERS[0][joint]] >= _TOUCHED)
                axes.axvline(start, color=color, lw=0.8, alpha=0.5)
        axes = all_axes[3, k]
        if s.wire_force is None:
            axes.text(0.5, 0.5, "no wires", transform=axes.transAxes, ha="center")
            continue
        for force, style in zip(s.wire_force.T, ("-", (0, (2, 2))), strict=True):
            axes.plot(s.time, force, color=COLORS[2], ls=style, lw=1.3)
        axes.axhline(s.wire_limit, color=COLORS[-1], lw=0.8, ls="--")
        axes.annotate(
            "the servo's limit",
            (0.0, s.wire_limit),
            xytext=(4, -10),
            textcoords="offset points",
            fontsize=7,
        )
    all_axes[0, 0].legend(fontsize=8, frameon=False)
    figure.align_ylabels(all_axes[:, 0])
    return figure
