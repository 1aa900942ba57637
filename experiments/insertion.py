"""Insertions: what cannot be inserted, strategies, wires, and the hand's hold on a peg.

`insertion_told` checks that the planner names the cause if an insertion is impossible:
a plate without a hole, a hole that is 0.05 mm too narrow, and a hole with a plug in it.

`insertion_turn` presses on the end of a held peg with rising force, until it leaves the
pads. Soft fingers alone might lead a peg into a hole, if they gave way and came back.

`insertion_strategies` draws the same parts and errors of the goal for every strategy.
The stiffer hand has the greatest stiffness of KUKA's Sunrise.OS, so that mainly the
fingers yield.

`insertion_wire` has the planner in one process and a served cell in another. With a
force limit below the push, the safety monitor must stop the arm.
"""

import dataclasses as dc

import numpy as np

import experiments.runner as ex
from drake_srg import Simulate, load_scenario
from drake_srg.common.srg_geometry import SRG
from drake_srg.objects.config import ObjectConfig
from drake_srg.planning.grasps.srg_hand import pinch_angles
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Cylinder
from experiments.hardware_loop import Way, run_served
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


STRATEGIES = ("tilt", "spiral", "push")
# Stiffness of the hand [N/m], [N m/rad].
HANDS = {"yielding": (2000.0, 200.0), "stiffer": (5000.0, 300.0)}


def strategy_trial(strategy: str, hand: str, seed: int) -> ex.Measures:
    along, about = HANDS[hand]
    changes = [
        *('chosen.clearance="0.1 mm"', f"planner.strategy={strategy}"),
        *(f"planner.stiffness={along}", f"planner.turning_stiffness={about}"),
        f"arm.cartesian.translation=[{along}, {along}, {along}]",
        f"arm.cartesian.rotation={about}",
    ]
    scenario = load_scenario("insert_varied", seed=seed, overrides=changes)
    metrics = Simulate(scenario).metrics
    return {
        "inserted": metrics.success,
        "force": metrics.hole_force_n,
        "cycle": metrics.cycle_time_s,
    }


def strategy_summary(own: ex.Trials) -> ex.Values:
    cycles = own.known("cycle")
    return ex.share("inserted", sum(own["inserted"]), len(own), spread=0.3) | {
        "largest force on the hole [N]": max(own["force"]),
        "median cycle [s]": np.median(cycles) if len(cycles) else np.nan,
    }


insertion_strategies = ex.Experiment(
    "Insertion at 0.1 mm: strategies, with a yielding and with a stiffer hand.",
    lambda trials=10, seed=76000: ex.grid(
        seed=range(seed, seed + trials), strategy=STRATEGIES, hand=HANDS
    ),
    strategy_trial,
    by=("strategy", "hand"),
    summary=strategy_summary,
    picture=[
        ex.Bars(["inserted"]),
        ex.Bars(["largest force on the hole"]),
        ex.Bars(["median cycle"]),
    ],
)


_RATE = 0.15  # simulated seconds per real second, which two busy cores reach
_LATE = Way("insert", latency=0.02, lead=0.12)
_LIMIT = "{hand: {transient: 8.0, quasi_static: 4.0}}"  # [N]
WAYS = {
    "no delay": Way("insert"),
    "20 ms late": _LATE,
    "20 ms late, force limit": dc.replace(
        _LATE,
        force=f"{{profile: {_LIMIT}, regions: [hand]}}",
        # With any such limit, the served arm publishes its external torques.
        settings=(f"planner.max_external_torque={7 * [300.0]}",),
    ),
}


def wire_summary(own: ex.Trials) -> ex.Values:
    stopped = sum("force" in told.split(", ") for told in own["told"])
    found: ex.Values = {
        "force on the hole [N]": (max(own["hole force"]), ex.at_most(MOST_FORCE))
    }
    if "limit" in own.name:
        return found | {"stopped by the limit []": (stopped, ex.at_least(len(own)))}
    return found | {"inserted []": (sum(own["placed"]), ex.at_least(len(own)))}


insertion_wire = ex.Experiment(
    "Insertions over ROS 2: with delay, and with a force limit.",
    lambda seeds=3: ex.grid(seed=range(seeds), way=WAYS),
    lambda seed, way: run_served(WAYS[way], seed, _RATE),
    by=("way",),
    summary=wire_summary,
    serial=True,
)
