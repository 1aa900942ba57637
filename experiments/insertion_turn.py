"""How far a peg turns between the pads when a force presses on its end.

Soft fingers alone might lead a peg into a hole, if they gave way and came back.
"""

import numpy as np

import experiments.runner as ex
from drake_srg.common.srg_geometry import SRG
from drake_srg.objects.config import ObjectConfig
from drake_srg.planning.grasps.srg_hand import pinch_angles
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Cylinder
from experiments.stands.holding import push

FORCES = (1.5, 3.0, 6.0, 15.0)  # on the end of a held peg [N]
_PALM = 0.226  # height of the palm over the table; the pads hold the peg's middle [m]


def trial(direction: str, radius: float) -> ex.Measures:
    """Return how far a peg has turned in the hand under each force [degrees]."""
    peg = ObjectConfig(shape=Cylinder(radius, 0.1), mass=0.1, friction=0.35)
    peg.modulus = 1e7  # as in `insert`
    bench = bench_scenario(
        peg,
        gripper_rpy=[0.0, 90.0, 0.0],
        home=[0.0, 0.0, _PALM],
        overrides=["gripper=!SrgPositionDriver {}"],
    )
    closure = (sum(pinch_angles(radius)) + bench.planner.squeeze) / SRG.full_scale
    aside = np.array([0.0, 1.0, 0.0] if direction == "along" else [1.0, 0.0, 0.0])
    turns: ex.Measures = {}
    with Rig(bench, name="insertion_turn") as rig:
        rig.advance(2.0, closure=closure)
        home = rig.commanded("arm.position_commanded")
        rig.move(home + np.array([0.0, 0.0, 0.05]), 1.0)
        axis, height = rig.X_GO().rotation().col(2).copy(), rig.X_WO().translation()[2]
        for force in FORCES:
            push(rig, "object", force * aside, [0.0, 0.0, -0.05])
            rig.advance(1.0)
            cosine = float(np.clip(axis @ rig.X_GO().rotation().col(2), -1.0, 1.0))
            turns[f"turn at {force:g} N [degrees]"] = np.rad2deg(np.arccos(cosine))
        turns["fallen [mm]"] = 1e3 * (height - rig.X_WO().translation()[2])
    return turns


insertion_turn = ex.Experiment(
    # Along the pinch axis and across it.
    lambda: ex.grid(direction=("along", "across"), radius=(0.0124, 0.0059)),
    trial,
    by=("direction", "radius"),
)
