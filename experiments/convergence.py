"""A wrapped and a pinched can, with halved time steps and refined meshes.

Each variant changes one thing in the accurate bench: the plant's time step, the facets
of the can, or the mesh of the pads. The finest of each may differ by an angle that
moves a fingertip, 0.11 m from the base hinge, by 2 mm, and by a tenth of a force.
"""

import numpy as np

import experiments.runner as ex
from drake_srg.common.srg_geometry import SRG
from drake_srg.simulation.rig import Rig, bench_scenario

_CAN_RADIUS, _CAN_LENGTH = 0.0339, 0.1018  # m
ACCURATE, BENCH = "accurate", "bench (box pads)"
_ACCURATE = "gripper_bench_accurate"
_FINEST_PADS = "package://drake_srg/sdf/srg_finest_pads.sdf"
# Scenario and overrides, each series from coarse to fine.
VARIANTS: dict[str, tuple[str, tuple[str, ...]]] = {
    ACCURATE: (_ACCURATE, ()),
    **{
        f"step {ms:g} ms": (
            _ACCURATE,
            (f"plant_config.time_step={ms * 1e-3}", f"arm.period={ms * 1e-3}"),
        )
        for ms in (4.0, 2.0, 0.5)
    },
    **{
        f"facets {mm:g} mm": (_ACCURATE, (f"object.resolution={mm * 1e-3}",))
        for mm in (10.0, 2.5)
    },
    BENCH: ("gripper_bench", ()),
    "finest pads": (_ACCURATE, (f"directives.gripper.add_model.file={_FINEST_PADS}",)),
}
FINEST = ("step 0.5 ms", "facets 2.5 mm", "finest pads")
# Roll, pitch, yaw [degrees] and position [m] of the hand. Wrapped: from the side, 2 mm
# between can and palm. Pinched: from above, the can's top at the roots of the pads.
GRIPS = {
    "wrapped": (
        (0.0, 0.0, 0.0),
        (-SRG.palm_face_x - 0.002 - _CAN_RADIUS, 0.0, _CAN_LENGTH / 2),
    ),
    "pinched": ((0.0, 90.0, 0.0), (0.0, 0.0, _CAN_LENGTH + 0.118)),
}


def cases() -> list[ex.Case]:
    return ex.grid(grip=GRIPS, variant=VARIANTS)


def trial(grip: str, variant: str) -> ex.Measures:
    """Close on the can of a bench, lift it and wait until everything is at rest."""
    (rpy, home), (scenario, overrides) = GRIPS[grip], VARIANTS[variant]
    bench = bench_scenario(
        gripper_rpy=rpy, home=home, scenario=scenario, overrides=overrides
    )
    with Rig(bench, name="convergence", log_period=0.02) as rig:
        rig.advance(3.5, closure=1.0)
        rig.move(np.array(home) + np.array([0.0, 0.0, 0.05]), 1.0)
        rig.advance(2.0)
        return {
            "held": set(rig.contact_forces()) == {"gripper"},
            "angles": rig.measured("gripper.state_measured")[:4],
            "forces": rig.measured("gripper.contact_force"),
        }


def differences(trials: ex.Trials) -> dict[str, ex.Values]:
    """Return how the accurate bench differs from others."""
    found: dict[str, ex.Values] = {}
    for grip in GRIPS:
        a = trials.where(grip=grip, variant=ACCURATE)[0]
        for variant in (*FINEST, BENCH):
            b = trials.where(grip=grip, variant=variant)[0]
            largest = max(b["forces"])
            angle = np.max(np.abs(a["angles"] - b["angles"]))
            force = np.max(np.abs(a["forces"] - b["forces"]))
            share = force / largest if largest > 0.0 else np.inf
            judged = variant != BENCH
            found[f"{grip}, accurate against {variant}"] = {
                "largest angle difference [rad]": (
                    angle,
                    ex.at_most(0.02) if judged else ex.number(),
                ),
                "largest relative force difference []": (
                    share,
                    ex.at_most(0.1) if judged else ex.number(),
                ),
            }
    return found


convergence = ex.Experiment(
    "A wrapped and a pinched can, with halved time steps and refined meshes.",
    cases,
    trial,
    {"variants that hold the can": lambda own: ex.at_least(len(own))},
    summary=lambda own: {"variants that hold the can []": sum(own["held"])},
    whole=differences,
    picture=[
        ex.Bars(["largest angle difference"]),
        ex.Bars(["largest relative force difference"]),
    ],
)
