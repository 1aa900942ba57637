"""Convergence of a wrapped and a pinched can with smaller time steps and finer meshes.

Each variant changes one thing in the accurate bench: the plant's time step, the facets
of the can, or the mesh of the pads. Between the two finest variants, a force
may differ by a tenth. An angle may differ by what moves a fingertip, 0.11 m from the
base hinge, by 2 mm.
"""

import numpy as np

import experiments.runner as ex
from drake_srg.common.srg_geometry import SRG
from drake_srg.simulation.rig import Rig, bench_scenario
from experiments.stands.holding import is_free

_CAN_RADIUS, _CAN_LENGTH = 0.0339, 0.1018  # m
ACCURATE, BENCH = "accurate", "bench (box pads)"
_FINEST_PADS = "package://drake_srg/sdf/srg_finest_pads.sdf"
# Overrides of the accurate bench, each series from coarse to fine.
VARIANTS: dict[str, tuple[str, ...]] = {
    ACCURATE: (),
    **{
        f"step {ms:g} ms": (
            f"plant_config.time_step={ms * 1e-3}",
            f"arm.period={ms * 1e-3}",
        )
        for ms in (4.0, 2.0, 0.5)
    },
    "facets 10 mm": ("object.resolution=0.01",),
    "facets 2.5 mm": ("object.resolution=0.0025",),
    BENCH: (),
    "finest pads": (f"directives.gripper.add_model.file={_FINEST_PADS}",),
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


def trial(grip: str, variant: str) -> ex.Measures:
    """Close on the can of a bench, lift it and wait until everything is at rest."""
    rpy, home = GRIPS[grip]
    bench = bench_scenario(
        gripper_rpy=rpy,
        home=home,
        scenario="gripper_bench" if variant == BENCH else "gripper_bench_accurate",
        overrides=VARIANTS[variant],
    )
    with Rig(bench, name="convergence", log_period=0.02) as rig:
        rig.advance(3.5, closure=1.0)
        rig.move(np.array(home) + np.array([0.0, 0.0, 0.05]), 1.0)
        rig.advance(2.0)
        return {
            "held": is_free(rig),
            "angles": rig.measured("gripper.state_measured")[:4],
            "forces": rig.measured("gripper.contact_force"),
        }


def differences(trials: ex.Trials) -> dict[str, ex.Values]:
    found: dict[str, ex.Values] = {}
    for grip in GRIPS:
        a = trials.where(grip=grip, variant=ACCURATE)[0]
        for variant in (*FINEST, BENCH):
            b = trials.where(grip=grip, variant=variant)[0]
            angle = np.max(np.abs(a["angles"] - b["angles"]))
            force, largest = np.max(np.abs(a["forces"] - b["forces"])), max(b["forces"])
            share = force / largest if largest > 0.0 else np.inf
            bounds = ex.at_most(0.02), ex.at_most(0.1)
            if variant == BENCH:
                bounds = ex.number(), ex.number()
            found[f"{grip}, accurate against {variant}"] = {
                "largest angle difference [rad]": (angle, bounds[0]),
                "largest relative force difference []": (share, bounds[1]),
            }
    return found


convergence = ex.Experiment(
    "A wrapped and a pinched can, with halved time steps and refined meshes.",
    lambda: ex.grid(grip=GRIPS, variant=VARIANTS),
    trial,
    {"variants that hold the can": lambda own: ex.at_least(len(own))},
    summary=lambda own: {"variants that hold the can []": sum(own["held"])},
    whole=differences,
)
