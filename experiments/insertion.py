"""Pegs into tight holes: which strategy, how stiff an arm, and what confirms a success.

`insertion` compares ways to find the hole at several clearances, with an arm that
yields and with one that yields less than half as much. `insertion_turn`
asks how far a peg turns between these when 15 N press on its end. A success may owe to
the simulation: contact that is too soft rounds off a rim, and long steps jump over it.
`insertion_confirmed` repeats trials with half the step and with ten times the
stiffness.
"""

from collections import Counter

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce

import experiments.runner as ex
from drake_srg.common.srg_geometry import SRG
from drake_srg.objects.config import ObjectConfig
from drake_srg.planning.grasps.srg_hand import pinch_angles
from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Cylinder, Failure

SCENARIO = "insert_varied"
CLEARANCES = {"1.0 mm": 0.0115, "0.3 mm": 0.0122, "0.1 mm": 0.0124, "0.05 mm": 0.01245}
# The planner refuses an arm whose spring it does not know, such as one with position
# control. The stiffest spring that Sunrise.OS offers comes nearest to that.
CONTROLS = {
    "impedance": [],
    "stiff": [
        "arm.cartesian.translation=[5000.0, 5000.0, 5000.0]",
        "arm.cartesian.rotation=300.0",
        "planner.stiffness=5000.0",
        "planner.turning_stiffness=300.0",
    ],
}
STRATEGIES = ("push", "spiral", "tilt")
STIFFNESS = "scene_graph_config.default_proximity_properties.point_stiffness"
CHANGES = {
    "half the step": ["plant_config.time_step=0.001"],
    "ten times the stiffness": [f"{STIFFNESS}=1e9"],
}
MOST_FORCE = 30.0  # between peg and hole [N]
FORCES = (1.5, 3.0, 6.0, 15.0)  # on the end of a held peg [N]
_PALM = 0.226  # height of the palm over the table; the pads hold the peg's middle [m]


def insert(clearance: str, seed: int, changes: list[str]) -> ex.Measures:
    """Insert the round peg of 25 mm with a sharp rim, and say how it ended."""
    chosen = {"part": "round_25", "clearance": clearance, "rim": "sharp"}
    overrides = [f"chosen.{group}={name}" for group, name in chosen.items()]
    scenario = load_scenario(SCENARIO, seed=seed, overrides=[*overrides, *changes])
    metrics = Simulate(scenario, name="insertion").metrics
    return {
        "inserted": metrics.success,
        "wrong claim": metrics.failure == Failure.MISPLACED.value,
        "failure": metrics.failure or "",
        "cycle [s]": metrics.cycle_time_s,
        "force on the hole [N]": metrics.hole_force_n,
    }


def cases(trials: int = 10, seed: int = 9000) -> list[ex.Case]:
    """Insert the same pegs by every strategy, with both arms."""
    axes = {"strategy": STRATEGIES, "clearance": CLEARANCES, "control": CONTROLS}
    return ex.grid(**axes, seed=range(seed, seed + trials))


def trial(strategy: str, clearance: str, control: str, seed: int) -> ex.Measures:
    changes = [*CONTROLS[control], f"planner.strategy={strategy}"]
    if strategy == "spiral":  # 1.5 times the clearance, as is usual
        pitch = 1.5 * (0.0125 - CLEARANCES[clearance])
        changes.append(f"planner.spiral_pitch={min(pitch, 1e-3)}")
    return insert(clearance, seed, changes)


def rates(own: ex.Trials) -> ex.Values:
    """Return shares with their 95 % intervals (Wilson), and the forces."""
    inserted = [bool(value) for value in own["inserted"]]
    low, high = ex.wilson(sum(inserted), len(inserted))
    force = np.array(own["force on the hole [N]"], dtype=float)
    return {
        "inserted [%]": 100.0 * float(np.mean(inserted)),
        "at least [%]": 100.0 * low,
        "at most [%]": 100.0 * high,
        "wrong claims": float(sum(own["wrong claim"])),
        "largest force [N]": float(np.max(force)),
        "trials within the force [%]": 100.0 * float(np.mean(force < MOST_FORCE)),
    }


insertion = ex.Experiment(
    "Strategies of insertion at several clearances, with a stiff and a soft arm.",
    cases,
    trial,
    {"wrong claims": ex.at_most(0.0)},
    by=("strategy", "clearance", "control"),
    summary=rates,
)


def confirmed_cases(trials: int = 10, seed: int = 9500) -> list[ex.Case]:
    """Insert pegs, and again with other steps and stiffness."""
    tight = ("0.1 mm", "0.05 mm")
    return ex.grid(clearance=tight, seed=range(seed, seed + trials))


def confirmed_trial(clearance: str, seed: int) -> ex.Measures:
    found = {"as it is": insert(clearance, seed, [])}
    if found["as it is"]["inserted"]:
        found |= {name: insert(clearance, seed, c) for name, c in CHANGES.items()}
    return {
        name: "inserted" if own["inserted"] else own["failure"]
        for name, own in found.items()
    } | {"wrong claims": sum(own["wrong claim"] for own in found.values())}


def confirmed(own: ex.Trials) -> ex.Values:
    """Return how many successes each change confirms."""
    values = {"wrong claims": float(sum(own["wrong claims"]))}
    done = [case for case in own if case["as it is"] == "inserted"]
    values["inserted [%]"] = 100.0 * len(done) / len(own)
    for name in CHANGES:
        ends = Counter(case[name] for case in done)
        share = ends["inserted"] / max(len(done), 1)
        values[f"confirmed by {name} [%]"] = 100.0 * share
    return values


insertion_confirmed = ex.Experiment(
    "Whether half the step and ten times the stiffness confirm insertions.",
    confirmed_cases,
    confirmed_trial,
    {
        "wrong claims": ex.at_most(0.0),
        **{f"confirmed by {name}": ex.at_least(95.0) for name in CHANGES},
    },
    by=("clearance",),
    summary=confirmed,
)


def turn_cases() -> list[ex.Case]:
    """Press on the end of pegs of two sizes, along the pinch axis and across it."""
    return ex.grid(direction=("along", "across"), radius=(0.0124, 0.0059))


def turn_trial(direction: str, radius: float) -> ex.Measures:
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
    turns: ex.Measures = {}
    with Rig(bench, name="insertion_turn") as rig:
        rig.advance(2.0, closure=closure)
        home = rig.commanded("arm.position_commanded")
        rig.move(home + np.array([0.0, 0.0, 0.05]), 1.0)
        axis, height = rig.X_GO().rotation().col(2).copy(), rig.X_WO().translation()[2]
        for force in FORCES:
            push = ExternallyAppliedSpatialForce()
            push.body_index = rig.plant.GetBodyByName("object").index()
            push.p_BoBq_B = np.array([0.0, 0.0, -0.05])
            aside = np.array(
                [0.0, 1.0, 0.0] if direction == "along" else [1.0, 0.0, 0.0]
            )
            push.F_Bq_W = SpatialForce(tau=np.zeros(3), f=force * aside)
            forces = rig.diagram.GetInputPort("object_forces_cheat")
            forces.FixValue(rig.context, AbstractValue.Make([push]))
            rig.advance(1.0)
            cosine = float(np.clip(axis @ rig.X_GO().rotation().col(2), -1.0, 1.0))
            turns[f"turn at {force:g} N [degrees]"] = np.rad2deg(np.arccos(cosine))
        turns["fallen [mm]"] = 1e3 * (height - rig.X_WO().translation()[2])
    return turns


insertion_turn = ex.Experiment(
    "How far a peg turns between the pads when a force presses on its end.",
    turn_cases,
    turn_trial,
    by=("direction", "radius"),
)
