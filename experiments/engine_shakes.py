"""Verdicts of Drake's solvers and of MuJoCo about the same shaken grasps.

The grasps of twenty household objects are drawn as by `drake-srg grasps`, from all
sides, and half of them are moved at random. Wire force, mass, friction and shake are
drawn as in `grasp_measures`. All engines get the same models, commands and times. An
object counts as lost once it has moved by 15 mm in the hand (`floating_grasps`). The
reference is the bench with finely meshed pads and steps of 1 ms. Times are processor
times.

Wires need a discrete plant. The convex integrator (CENIC) is therefore tested with
joint servos, on the bench of `drake-srg grasps`, and compared with `accurate` there. A
grasp holds if it withstands 1 g.
"""

from collections.abc import Mapping, Sequence

import numpy as np

import experiments.runner as ex
from drake_srg.learning.grasp_bench import GraspBench
from drake_srg.objects.household import HOUSEHOLD, household_object
from experiments.engines import DRAKE as COARSE
from experiments.engines import MUJOCO as OPTIONS
from experiments.stands.floating_grasps import draw, in_drake, in_mujoco

REFERENCE, SERVOS = "Drake, accurate", "Drake, accurate, joint servos"
CENIC = "Drake, CENIC, joint servos"
# Scenario and overrides.
DRAKE: Mapping[str, tuple[str, tuple[str, ...]]] = {
    REFERENCE: ("gripper_bench_accurate", ()),
    **COARSE,
    "Drake, lagged": (
        "gripper_bench",
        ("plant_config.discrete_contact_approximation=lagged",),
    ),
}
PHYSICS = {SERVOS: "accurate", CENIC: "train"}
_SAME = ("as exported", "friction as in Drake", "without torsion", "its defaults")
MUJOCO = {f"MuJoCo, {name}": OPTIONS[f"MuJoCo, {name}"] for name in _SAME}
ENGINES = (*DRAKE, *PHYSICS, *MUJOCO)


def cases(
    objects: Sequence[str] = (), engines: Sequence[str] = (), shakes: int = 4
) -> list[ex.Case]:
    """Shake every object in every engine.

    Args:
        shakes: Of each object; 100 take 7 hours of one core.
    """
    return ex.grid(
        shake=range(shakes),
        object=ex.chosen("objects", objects, HOUSEHOLD),
        engine=ex.chosen("engines", engines, ENGINES),
    )


def trial(shake: int, object: str, engine: str) -> ex.Measures:
    drawn = draw(object, shake)
    if engine in PHYSICS:
        model = str(household_object(object).model)
        label = GraspBench(model, 1.0, "srg", PHYSICS[engine]).label(drawn.grasp)
        return {"touched": label is None, "held": bool(label and label.success)}
    scenario, overrides = DRAKE.get(engine, ("gripper_bench", ()))
    bench = drawn.scenario(object, scenario, overrides)
    if engine in MUJOCO:
        return in_mujoco(drawn, bench, MUJOCO[engine])
    return in_drake(drawn, bench)


def agreement(trials: ex.Trials) -> dict[str, ex.Values]:
    """Compare the verdicts of each engine with those of its reference."""
    engines, found = trials.groups("engine"), {}
    for name, own in engines.items():
        reference = engines.get(SERVOS if name in PHYSICS else REFERENCE)
        held = np.array(own["held"])
        values: ex.Values = _costs(own)
        if reference is not None:
            tested = ~(np.array(own["touched"]) | np.array(reference["touched"]))
            values["grasps that hold []"] = np.sum(held & tested)
            values["grasps tested []"] = np.sum(tested)
            if name not in (REFERENCE, SERVOS):
                ours, theirs = held[tested], np.array(reference["held"])[tested]
                same = int(np.sum(ours == theirs))
                values |= ex.share("same verdict", same, len(ours), spread=0.05)
                values["holds what the reference loses []"] = np.sum(ours & ~theirs)
                values["loses what the reference holds []"] = np.sum(theirs & ~ours)
        found[name] = values
    return found


def _costs(own: ex.Trials) -> ex.Values:
    found: ex.Values = {}
    held = [t for t in own if t["held"]]
    for measure, unit in (("creep", "um/s"), ("depth", "mm"), ("moved", "mm")):
        values = [t[measure] for t in held if measure in t]
        if values:
            found[f"median {measure} [{unit}]"] = np.median(values)
    walls = [t["wall"] for t in own if not t["touched"] and "wall" in t]
    if walls:
        found["processor time of a grasp [s]"] = np.mean(walls)
    return found


engine_shakes = ex.Experiment(
    "Twenty household objects, grasped anyhow and shaken, in Drake and MuJoCo.",
    cases,
    trial,
    {"processor time of a grasp": ex.number(clock="time")},
    by=("engine",),
    summary=lambda own: {},
    whole=agreement,
    picture=[
        ex.Bars(["same verdict"]),
        ex.Bars(["holds what the reference loses", "loses what the reference holds"]),
    ],
    serial=True,
)
