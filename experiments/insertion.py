"""Pegs that cannot be inserted, and the hand's hold on those that can.

`insertion_told` checks that the planner names the cause if an insertion is impossible:
a plate without a hole, a hole that is 0.05 mm too narrow, and a hole with a plug in it.

`insertion_turn` presses on the end of a held peg with rising force, until it leaves the
pads. Soft fingers alone might lead a peg into a hole, if they gave way and came back.
"""

import numpy as np

import experiments.runner as ex
from drake_srg import Simulate, load_scenario
from drake_srg.common.srg_geometry import SRG
from drake_srg.objects.config import ObjectConfig
from drake_srg.planning.grasps.srg_hand import pinch_angles
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Cylinder
from experiments.stands.holding import push

HOLES = {
    "no_hole": "directives.hole.add_model.file=package://drake_srg/sdf/hole_none.sdf",
    "too_tight": "objects.peg.shape.radius=0.01255",
    "hole_blocked": (
        "objects.plug={shape: !Cylinder {radius: 0.01, length: 0.01}, mass: 0.05,"
        " friction: 0.3, known: false, color: [0.2, 0.2, 0.2],"
        " pose: {translation: [0.55, -0.3, 0.0151]}}"
    ),
}
MOST_FORCE = 30.0  # between peg and hole [N]
FORCES = (1.5, 3.0, 6.0, 15.0)  # on the end of a held peg [N]
_LENGTH = 0.1  # of the peg that is turned [m]
_PALM = 0.226  # height of the palm over the table; the pads hold the peg's middle [m]


def told_trial(failure: str) -> ex.Measures:
    changes = [HOLES[failure], "planner.tries=1"]
    metrics = Simulate(load_scenario("insert", overrides=changes)).metrics
    return {
        "told by name []": float(metrics.failure == failure),
        "force on the hole [N]": metrics.hole_force_n,
    }


insertion_told = ex.Experiment(
    "Impossible insertions: the cause that is reported, and the force on the hole.",
    lambda: ex.grid(failure=HOLES),
    told_trial,
    {
        "told by name": ex.at_least(1.0),
        "force on the hole": ex.at_most(MOST_FORCE),
    },
)


def turn_trial(direction: str, radius: float) -> ex.Measures:
    """Return how far a peg has turned under each force that it is held against."""
    peg = ObjectConfig(shape=Cylinder(radius, _LENGTH), mass=0.1, friction=0.35)
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
        start, height, held_up_to = rig.X_GO(), rig.X_WO().translation()[2], 0.0
        for force in FORCES:
            push(rig, "object", force * aside, [0.0, 0.0, -0.5 * _LENGTH])
            rig.advance(1.0)
            now = rig.X_GO()
            moved = np.linalg.norm(now.translation() - start.translation())
            if moved > 0.5 * _LENGTH:  # no end of it is between the pads any more
                break
            cosine = start.rotation().col(2) @ now.rotation().col(2)
            turn = np.rad2deg(np.arccos(np.clip(float(cosine), -1.0, 1.0)))
            turns[f"turn at {force:g} N [degrees]"] = turn
            turns["fallen [mm]"] = 1e3 * (height - rig.X_WO().translation()[2])
            held_up_to = force
    return turns | {"held up to [N]": held_up_to}


insertion_turn = ex.Experiment(
    "The turn of a peg between the pads when a force presses on its end.",
    # Along the pinch axis and across it.
    lambda: ex.grid(direction=("along", "across"), radius=(0.0124, 0.0059)),
    turn_trial,
    by=("direction", "radius"),
    picture=[
        ex.Bars([f"turn at {force:g} N" for force in FORCES]),
        ex.Bars(["held up to"]),
        ex.Bars(["fallen"]),
    ],
)
