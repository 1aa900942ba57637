"""Joint angles of a finger that closes on nothing against the force of its wire.

The complete driver winds its wires step by step and waits for rest, so that wire force
and angles balance. As in the vendor's model, there is neither gravity nor contact. The
finger closes once with the vendor's stops and once with ours.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.geometry import CollisionFilterDeclaration, GeometrySet

from drake_srg.common.srg_geometry import SRG
from drake_srg.experiments.data import read_csv
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.gripper.tendon import base_moment_arm, tip_moment_arm
from drake_srg.gripper.underactuation import FINGERS
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Vector

# Upper stops of base and tip [rad]: of the MuJoCo model and of SAKE's URDF.
STOPS = {"vendor": (2.0068, 1.745), "ours": (SRG.joint_limit, SRG.joint_limit)}
_WORDS = {"vendor": "vendor's stops", "ours": "our stops"}
FINE_STEPS = 30  # into which the spool step is divided in which the tip starts
# Time to come to rest. The motor settles as exp(-24 t), the slower pole of its loop. A
# finger on a slack spring, whose force hardly changes with the angle, takes longer [s].
SETTLE = 1.0
# Command beyond the tip's stop [rad], because the wires stretch and the servo yields.
_EXCESS = 0.5
TOLERANCE = 0.03  # relative
# Smaller angles count as this one: the vendor's angles come in steps of 0.05 degrees,
# and 3 % of this angle is about two of them [rad].
SMALL = np.deg2rad(3.0)
# One count of a 12-bit encoder: a joint this close to 0 or a stop is there [rad].
_COUNT = 2.0 * np.pi / 4096.0
_TIP = FINGERS[0][1]


@dc.dataclass(frozen=True)
class Closing:
    """A finger at rest at increasing spool angles.

    Attributes:
        force: Of the wire, shape (K,) [N].
        base: Angle, shape (K,) [rad].
        tip: Angle, shape (K,) [rad].
        speed: Of the fastest joint at any reading [rad/s].
        asymmetry: Largest difference between the fingers [rad].
    """

    force: Vector
    base: Vector
    tip: Vector
    speed: float = 0.0
    asymmetry: float = 0.0


def close(stops: tuple[float, float], steps: int) -> Closing:
    """Wind the wires in equal steps until both joints are at their stops.

    Args:
        stops: Upper stops of base and tip [rad].
        steps: Number of steps.
    """
    full_scale = sum(STOPS["vendor"]) + _EXCESS
    spool = f"{{full_scale: {full_scale}, base_limit: {stops[0]}}}"
    scenario = bench_scenario(
        overrides=[f"gripper=!SrgTendonDriver {{spool: {spool}}}"]
    )
    scenario.objects, scenario.task.pick = {}, ""
    with Rig(scenario, name="free_closing") as rig:
        _free_the_fingers(rig, stops)

        def settle(closure: float) -> Vector:
            rig.advance(SETTLE, closure=closure)
            state = rig.measured("gripper.state_measured")
            row: Vector = np.array(
                [closure, *state, rig.measured("gripper.wire_force")[0]]
            )
            return row

        rows = [settle(closure) for closure in np.linspace(0.0, 1.0, steps + 1)]
        before = [row for row in rows if row[1 + _TIP] < _COUNT][-1][0]
        settle(before)  # an extra period, because the way back is long
        for k in range(1, FINE_STEPS):
            rows.append(settle(before + k / (FINE_STEPS * steps)))
    _, *state, force = np.array(sorted(rows, key=lambda row: float(row[0]))).T
    left, right = (np.array(state)[list(finger)] for finger in FINGERS)
    return Closing(
        force=force,
        base=left[0],
        tip=left[1],
        speed=float(np.max(np.abs(state[4:]))),
        asymmetry=float(np.max(np.abs(left - right))),
    )


def _free_the_fingers(rig: Rig, stops: tuple[float, float]) -> None:
    """Set the joints' stops and remove gravity and contact."""
    for side in ("left", "right"):
        for link, stop in zip(("base", "tip"), stops, strict=True):
            joint = rig.plant.GetJointByName(f"{side}_{link}_joint")
            joint.set_position_limits([0.0], [stop])
    rig.plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    scene_graph = rig.station.GetSubsystemByName("scene_graph")
    everything = GeometrySet(scene_graph.model_inspector().GetAllGeometryIds())
    context = scene_graph.GetMyMutableContextFromRoot(rig.context)
    scene_graph.collision_filter_manager(context).Apply(
        CollisionFilterDeclaration().ExcludeWithin(everything)
    )


def run(track: Track, *, steps: int = 150) -> ExperimentResult:
    """Close with the vendor's stops and with ours.

    Args:
        track: Shows progress.
        steps: Number of steps of the spool.
    """
    closings = {name: close(STOPS[name], steps) for name in track(list(STOPS))}
    table = vendor_closing()
    tables: dict[str, dict[str, Vector]] = {
        f"{name}_stops": {
            "wire force [N]": closing.force,
            "base [rad]": closing.base,
            "tip [rad]": closing.tip,
        }
        for name, closing in closings.items()
    }
    ours = closings["vendor"]
    tables["comparison"] = {
        "wire force [N]": table.force,
        "vendor: base [rad]": table.base,
        "base [rad]": _at_force(ours, ours.base, table.force),
        "vendor: tip [rad]": table.tip,
        "tip [rad]": _at_force(ours, ours.tip, table.force),
    }
    rows = [*judge_arms(), *judge(ours, table), *judge_phases(closings)]
    return ExperimentResult(rows, tables, draw(closings, table))


def vendor_closing() -> Closing:
    """Return the statics of the vendor's model."""
    lines = read_csv("tendon_free_closing.csv")[1:]
    force, base, tip = np.array([[float(x) for x in s.split(",")] for s in lines]).T
    return Closing(force, base, tip)


def vendor_arms() -> dict[str, tuple[Vector, Vector]]:
    """Return angles [rad] and moment arms [m] of the vendor's model, by joint."""
    cells = [line.split(",") for line in read_csv("tendon_moment_arms.csv")[1:]]
    return {
        joint: (
            np.array([float(angle) for name, angle, _ in cells if name == joint]),
            np.array([float(arm) for name, _, arm in cells if name == joint]),
        )
        for joint in ("base", "tip")
    }


def judge_arms() -> list[Row]:
    """Compare our moment arms with the vendor's."""
    rows = []
    for joint, (angle, arm) in vendor_arms().items():
        ours = {"base": base_moment_arm, "tip": tip_moment_arm}[joint](angle)
        off = float(np.max(np.abs(ours / arm - 1.0)))
        quantity = "moment arm, largest deviation"
        rows.append(Row.at_most(joint, quantity, 100 * TOLERANCE, 100 * off, "%"))
    return rows


def judge(ours: Closing, table: Closing) -> list[Row]:
    """Compare angles at equal force, and forces at equal angle, over the whole table.

    Deviations of an angle are relative to the vendor's angle, but at least to `SMALL`.
    Forces are compared where the joint is between its stops: at a stop, many forces
    belong to one angle.
    """
    rows = [
        Row.at_least("all", "wire force reached", table.force[-1], ours.force[-1], "N"),
        Row.at_most(
            "all", "largest joint speed at readings", 1e-3, ours.speed, "rad/s"
        ),
        Row.at_most(
            "all", "largest left-right difference", 1e-6, ours.asymmetry, "rad"
        ),
    ]
    for joint in ("base", "tip"):
        q, expected = getattr(ours, joint), getattr(table, joint)
        off = np.abs(_at_force(ours, q, table.force) - expected)
        share = 100 * float(np.max(off / np.maximum(expected, SMALL)))
        degrees = float(np.rad2deg(np.max(off)))
        moving = (expected > 0.0) & (expected < expected[-1])
        force = np.interp(expected[moving], q, ours.force)
        force_off = 100 * float(np.max(np.abs(force / table.force[moving] - 1.0)))
        small_off = 100 * float(np.max(off[moving] / expected[moving]))
        limit = 100 * TOLERANCE
        rows += [
            Row.at_most(joint, "angle at equal force", limit, share, "%"),
            Row.at_most(joint, "force at equal angle", limit, force_off, "%"),
            Row.info(joint, "angle at equal force", degrees, "degrees"),
            Row.info(
                joint, "angle at equal force, also below 3 degrees", small_off, "%"
            ),
        ]
    return rows


def judge_phases(closings: Mapping[str, Closing]) -> list[Row]:
    """Expect the base to close to its stop before the tip starts."""
    rows = []
    for name, closing in closings.items():
        stop = STOPS[name][0]
        arrived = int(np.argmax(closing.base > stop - _COUNT))
        started = int(np.argmax(closing.tip > _COUNT))
        tip = float(np.max(closing.tip[: arrived + 1]))
        base = float(np.max(np.abs(closing.base[started:] - stop)))
        at_stop, at_start = closing.force[arrived - 1], closing.force[started]
        case = _WORDS[name]
        rows += [
            Row.at_most(case, "tip angle until the base stops", _COUNT, tip, "rad"),
            Row.at_most(case, "base off its stop after that", _COUNT, base, "rad"),
            Row.info(case, "wire force just before the base stops", at_stop, "N"),
            Row.at_least(
                case, "wire force when the tip starts", at_stop, at_start, "N"
            ),
        ]
    return rows


def _at_force(closing: Closing, angle: Vector, force: Vector) -> Vector:
    """Return an angle, interpolated at forces (K,) [rad]."""
    result: Vector = np.interp(force, closing.force, angle)
    return result


def draw(closings: Mapping[str, Closing], table: Closing) -> Any:
    """Draw angles over force in both phases, and the moment arms."""
    figure = make_figure(11.0, 4.2, "A finger that closes on nothing")
    base_axes, axes, arm_axes = figure.subplots(1, 3, width_ratios=[1.1, 1.6, 1.1])
    force_label = "wire force [N]"
    style_axes(base_axes, xlabel=force_label, ylabel="angle [rad]")
    style_axes(axes, xlabel=force_label)
    style_axes(arm_axes, xlabel="angle [rad]", ylabel="moment arm of the wire [mm]")
    for panel, title, end in (
        (base_axes, "Base closes first ...", 2.0),
        (axes, "... then the tip", 14.0),
    ):
        panel.set_title(title, fontsize=9, loc="left")
        panel.set_xlim(0.0, end)
        panel.set_ylim(-0.05, 2.1)
        for joint, color in zip(("base", "tip"), COLORS, strict=False):
            for name, closing in closings.items():
                panel.plot(
                    closing.force,
                    getattr(closing, joint),
                    color=color,
                    lw=1.4 if name == "vendor" else 1.0,
                    ls="-" if name == "vendor" else (0, (4, 3)),
                    label=f"{joint}, {_WORDS[name]}",
                )
            every = slice(None, None, 3 if panel is axes else 1)
            panel.plot(
                table.force[every],
                getattr(table, joint)[every],
                "o",
                ms=3.5,
                mfc="none",
                color=color,
                label=f"{joint}, vendor's model",
            )
    axes.legend(fontsize=8, frameon=False, loc=(0.42, 0.12))
    arm_axes.set_title("Moment arms", fontsize=9, loc="left")
    for (joint, (angle, arm)), color in zip(
        vendor_arms().items(), COLORS, strict=False
    ):
        ours = {"base": base_moment_arm, "tip": tip_moment_arm}[joint](angle)
        arm_axes.plot(angle, 1e3 * ours, color=color, label=joint)
        arm_axes.plot(angle[::3], 1e3 * arm[::3], "o", ms=3.5, mfc="none", color=color)
    arm_axes.set_ylim(0.0)
    arm_axes.legend(fontsize=8, frameon=False)
    return figure
