"""Household objects grasped and shaken in Drake and in MuJoCo, with the same models.

The grasps are those of `household`; afterwards, the hand waits for 5 s. MuJoCo loads
the files that `drake-srg export` writes. A grasp holds if the object moves less than 5
mm in the hand. The reference is Drake with contact surfaces.

For two coefficients of friction, MuJoCo uses the larger and Drake the harmonic mean. On
objects with a coefficient of 0.5, the pads (0.8) therefore grip 1.3 times as well in
MuJoCo.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

import experiments.runner as ex
from experiments.data import household_objects
from experiments.household import SLIP
from experiments.stands import grasps, mujoco_grasps

HOLD = 5.0  # s
FIT = 22  # of the 23 grasps; `household` says why one object is too wide
CREEP = 5.0  # a tenth of the least that MuJoCo's users report [um/s]
REFERENCE = "Drake, SAP"
# Scenario and overrides.
DRAKE: dict[str, tuple[str, tuple[str, ...]]] = {
    REFERENCE: ("gripper_bench", ()),
    "Drake, point contact": ("gripper_bench", ("plant_config.contact_model=point",)),
}
_COARSE = {"timestep": 0.002, "noslip_iterations": 0}
# What replaces the options of the exported files.
MUJOCO: dict[str, dict[str, Any]] = {
    "MuJoCo, as exported": {},
    "MuJoCo, friction as in Drake": {"harmonic": True},
    "MuJoCo, 1 ms": {"timestep": 0.001},
    "MuJoCo, noslip to 1e-6": {"noslip_tolerance": 1e-6},
    "MuJoCo, without noslip": {"noslip_iterations": 0},
    "MuJoCo, without torsion": {"condim": 3},
    "MuJoCo, its defaults": {**_COARSE, "condim": 3, "cone": 0, "impratio": 1.0},
}


def cases(objects: Sequence[str] = (), engines: Sequence[str] = ()) -> list[ex.Case]:
    """Grasp every object in every way, in every engine."""
    known = {name for name, _ in grasps.grasps()}
    wanted = ex.chosen("objects", objects, known)
    return [
        {"engine": engine, "object": name, "approach": approach}
        for engine in ex.chosen("engines", engines, [*DRAKE, *MUJOCO])
        for name, approach in grasps.grasps()
        if name in wanted
    ]


def trial(engine: str, object: str, approach: str) -> ex.Measures:
    grasp, thing = grasps.grasps()[object, approach], household_objects()[object]
    if engine in MUJOCO:
        scenario = grasps.present(thing, grasp)
        return mujoco_grasps.simulate(scenario, grasp, MUJOCO[engine], HOLD)
    found = grasps.simulate(grasps.present(thing, grasp, *DRAKE[engine]), grasp, HOLD)
    return {key: found[key] for key in ("slip", "creep", "wall")}


def summary(own: ex.Trials) -> ex.Values:
    held = np.array(own["slip"]) < SLIP
    creep = np.array(own["creep"])[held] if any(held) else np.nan
    return {
        "grasps that hold []": np.sum(held),
        "median creep [um/s]": np.median(creep),
        "greatest creep [um/s]": np.max(creep),
        "wall time per simulated second [s]": np.mean(own["wall"]),
    }


def agreement(trials: ex.Trials) -> dict[str, ex.Values]:
    held = {
        name: np.array(own["slip"]) < SLIP
        for name, own in trials.groups("engine").items()
    }
    return {
        name: {"verdicts as of the reference []": np.sum(verdicts == held[REFERENCE])}
        for name, verdicts in held.items()
        if name != REFERENCE and REFERENCE in held
    }


engines = ex.Experiment(
    "One gripper and 23 household grasps in Drake and MuJoCo.",
    cases,
    trial,
    {
        "grasps that hold": {"MuJoCo, as exported": ex.at_least(FIT)},
        "greatest creep": {"MuJoCo, as exported": ex.at_most(CREEP)},
        "wall time per simulated second": ex.number(clock="time"),
    },
    by=("engine",),
    summary=summary,
    whole=agreement,
    picture=[
        ex.Bars(["grasps that hold"]),
        ex.Bars(["median creep", "greatest creep"], log=True),
    ],
    serial=True,
)
