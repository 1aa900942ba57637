"""A wrapped and a pinched can, with halved time steps and refined meshes.

Each variant changes one thing in the accurate bench: the plant's time step, the facets
of the can, or the mesh of the pads.
"""

from __future__ import annotations

import dataclasses as dc
from typing import Any

import numpy as np

from drake_srg.common.srg_geometry import SRG
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.gripper.underactuation import JOINT_NAMES
from drake_srg.recording.timeline import make_figure, style_axes
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Vector

# Largest differences between the accurate bench and each of its finest variants: an
# angle that moves a fingertip, 0.11 m from the base hinge, by 2 mm [rad], and a tenth
# of a force.
ANGLE, FORCE = 0.02, 0.1
_CAN_RADIUS, _CAN_LENGTH = 0.0339, 0.1018  # m
ACCURATE, BENCH, FINEST_PADS = "accurate", "bench (box pads)", "finest pads"
_ACCURATE = "gripper_bench_accurate"
_FINEST_PADS = "package://drake_srg/sdf/srg_finest_pads.sdf"
_STEPS: dict[str, dict[str, object]] = {
    f"{ms:g} ms": {"plant_config.time_step": ms * 1e-3, "arm.period": ms * 1e-3}
    for ms in (4.0, 2.0, 0.5)
}
_FACETS: dict[str, dict[str, object]] = {
    f"{mm:g} mm": {"object.resolution": mm * 1e-3} for mm in (10.0, 2.5)
}
# Scenario and changes, each series from coarse to fine.
VARIANTS: dict[str, tuple[str, dict[str, object]]] = {
    ACCURATE: (_ACCURATE, {}),
    **{f"step {k}": (_ACCURATE, v) for k, v in _STEPS.items()},
    **{f"facets {k}": (_ACCURATE, v) for k, v in _FACETS.items()},
    BENCH: ("gripper_bench", {}),
    FINEST_PADS: (_ACCURATE, {"directives.gripper.add_model.file": _FINEST_PADS}),
}
FINEST = ("step 0.5 ms", "facets 2.5 mm", FINEST_PADS)
# Roll, pitch, yaw [degrees] and position [m] of the hand. Wrapped: from the side, 2 mm
# between can and palm. Pinched: from above, the can's top at the roots of the pads.
GRIPS = {
    "wrapped": (
        (0.0, 0.0, 0.0),
        (-SRG.palm_face_x - 0.002 - _CAN_RADIUS, 0.0, _CAN_LENGTH / 2),
    ),
    "pinched": ((0.0, 90.0, 0.0), (0.0, 0.0, _CAN_LENGTH + 0.118)),
}


@dc.dataclass(frozen=True)
class Grip:
    """The final state of a grasp, joints and links in order of `JOINT_NAMES`.

    Attributes:
        held: Whether only the hand touches the can.
        angles: Of the joints, shape (4,) [rad].
        forces: On the closing sides of the links, shape (4,) [N].
    """

    held: bool
    angles: Vector
    forces: Vector


def grasp(grip: str, scenario: str, changes: dict[str, object]) -> Grip:
    """Close on the can of a bench, lift it and wait until everything is at rest."""
    rpy, home = GRIPS[grip]
    bench = bench_scenario(
        gripper_rpy=rpy,
        home=home,
        scenario=scenario,
        overrides=[f"{key}={value}" for key, value in changes.items()],
    )
    with Rig(bench, name="convergence", log_period=0.02) as rig:
        rig.advance(3.5, closure=1.0)
        rig.move(np.array(home) + np.array([0.0, 0.0, 0.05]), 1.0)
        rig.advance(2.0)
        return Grip(
            held=set(rig.contact_forces()) == {"gripper"},
            angles=rig.measured("gripper.state_measured")[:4],
            forces=rig.measured("gripper.contact_force"),
        )


def difference(a: Grip, b: Grip) -> tuple[float, float]:
    """Return the largest angle difference [rad] and relative force difference.

    Force differences are relative to b's largest force; infinite if b has none.
    """
    largest = float(np.max(b.forces))
    force = float(np.max(np.abs(a.forces - b.forces)))
    angle = float(np.max(np.abs(a.angles - b.angles)))
    return angle, force / largest if largest > 0.0 else np.inf


def run(track: Track) -> ExperimentResult:
    """Grasp with every variant and compare the accurate bench with the others."""
    grips = {
        (grip, variant): grasp(grip, *VARIANTS[variant])
        for grip, variant in track(
            [(grip, variant) for grip in GRIPS for variant in VARIANTS],
            label=", ".join,
        )
    }
    rows = []
    for grip in GRIPS:
        held = [g.held for (name, _), g in grips.items() if name == grip]
        rows.append(
            Row.at_least(grip, "variants that hold the can", len(held), sum(held), "")
        )
        for variant in (*FINEST, BENCH):
            case = f"{grip}, accurate against {variant}"
            angle, force = difference(grips[grip, ACCURATE], grips[grip, variant])
            what = ("largest angle difference", "largest relative force difference")
            if variant == BENCH:  # informative only
                rows.append(Row.info(case, what[0], angle, "rad"))
                rows.append(Row.info(case, what[1], force, ""))
            else:
                rows.append(Row.at_most(case, what[0], ANGLE, angle, "rad"))
                rows.append(Row.at_most(case, what[1], FORCE, force, ""))
    columns: dict[str, Any] = {
        "grip": [grip for grip, _ in grips],
        "variant": [variant for _, variant in grips],
        "held": [int(g.held) for g in grips.values()],
    }
    for i, joint in enumerate(JOINT_NAMES):
        columns[f"{joint}_rad"] = [g.angles[i] for g in grips.values()]
        columns[f"{joint}_N"] = [g.forces[i] for g in grips.values()]
    return ExperimentResult(rows, {"grips": columns}, _draw(grips))


def _draw(grips: dict[tuple[str, str], Grip]) -> Any:
    figure = make_figure(9.0, 5.2, "Left finger on a can, by step and mesh")
    panels = figure.subplots(2, 2, sharex=True)
    for row, grip in zip(panels, GRIPS, strict=True):
        for axes, (what, unit) in zip(
            row, (("angles", "rad"), ("forces", "N")), strict=True
        ):
            style_axes(axes, ylabel=f"{grip}: {what} [{unit}]")
            for joint in (0, 2):
                values = [getattr(grips[grip, v], what)[joint] for v in VARIANTS]
                axes.plot(list(VARIANTS), values, "o", label=JOINT_NAMES[joint])
                axes.axhline(values[0], lw=0.5, color="#888888")
            axes.set_ylim(bottom=0.0)
            axes.tick_params(axis="x", rotation=60)
    panels[0, 0].legend(fontsize=8, frameon=False)
    return figure
