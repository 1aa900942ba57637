"""Measures of grasps against simulated shakes: which of them tell what will hold.

The grasps of data/grasps.yaml are shifted at random. Wire force, friction and mass are
drawn so that about half of the objects are lost. Each grasp closes and lifts. The
contacts then give the measures, and a shake shows whether the grasp holds.

AUC is the chance that a measure ranks a grasp that holds above one that does not: 0.5
for a coin, 1 for an oracle. It is computed over all objects, and as a mean over
objects, because a measure may only distinguish light objects from heavy ones. The
acceleration that a grasp can resist predicts best. Measures that use only the places of
the contacts are hardly better than a coin.
"""

import copy
import dataclasses as dc
import time
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.stats import mannwhitneyu

import experiments.runner as ex
from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.household import object_facts
from drake_srg.planning.grasps.grasp_measures import MEASURES
from drake_srg.simulation.rig import Rig, shake
from drake_srg.station.held_grasp import read_grasp
from drake_srg.types import Vector
from experiments.data import household_objects
from experiments.household import OPENING
from experiments.stands.grasps import grasps, present, width_between_pads
from experiments.stands.holding import is_free

Flags = npt.NDArray[np.bool_]
# Shift along the palm's x, y, z (never deeper, where the table or the palm is) [m].
_SHIFT_LOW = np.array([0.0, -0.004, -0.012])
_SHIFT_HIGH = np.array([0.012, 0.004, 0.012])
# Of the wire force and the mass of data/grasps.yaml and of the model.
_FORCE, _MASS = (0.3, 1.2), (0.5, 2.5)
_FRICTION = (0.3, 0.9)  # of the object
# Times [s]: the hand comes, closes until its joints stand still, lifts, and rests.
_ARRIVE, _LEAST_CLOSE, _MOST_CLOSE, _LIFT, _REST = 0.4, 0.5, 2.5, 0.4, 0.2
_CHECK, _STILL = 0.1, 0.02  # how often, s; rad/s
_RETREAT, _RISE = 0.5, 0.06  # share of the grasp's own retreat; m
# Two cycles that swell, one at full strength and two that fade, as in `household`, but
# in one direction, drawn at random, at up to three times that strength.
_SHAKE, _FREQUENCY = 1.25, 4.0  # s, Hz
_STRENGTH = (5.0, 30.0)  # m/s²
_LOST = 0.015  # motion in the hand that loses the object [m]
_FEW = 5  # grasps that held, or that did not, below which an object's AUC says nothing


def cases(trials: int = 2000, seed: int = 0) -> list[ex.Case]:
    """Shake grasps of every object."""
    possible = [
        {"object": name, "approach": approach}
        for (name, approach), grasp in grasps().items()
        if not 1e3 * width_between_pads(name, grasp) > OPENING
    ]
    n = len(possible)
    return [possible[i % n] | {"seed": seed + i // n} for i in range(trials)]


def trial(object: str, approach: str, seed: int) -> ex.Measures:
    """Close, lift, read the contacts, shake, and see whether the grasp holds."""
    drawn = np.random.default_rng([seed, sum(map(ord, f"{object}, {approach}"))])
    grasp = grasps()[object, approach]
    # In the palm, a shallower grasp has the object farther out.
    grip = np.array(grasp.grip) + drawn.uniform(_SHIFT_LOW, _SHIFT_HIGH)
    retreat = _RETREAT * np.array(grasp.retreat)
    grasp = dc.replace(grasp, grip=list(grip), retreat=list(retreat))
    thing = copy.deepcopy(household_objects()[object])
    mass = thing.mass or object_facts(object, thing).mass
    thing.mass = mass * float(np.exp(drawn.uniform(*np.log(_MASS))))
    thing.friction = float(drawn.uniform(*_FRICTION))
    force = grasp.wire_force * float(np.exp(drawn.uniform(*np.log(_FORCE))))
    bench = present(thing, grasp, "gripper_bench_fast")
    limit = bench.gripper.wire_motor.drive.force_limit_of(force)
    direction = drawn.normal(size=3)
    strength = float(drawn.uniform(*_STRENGTH))
    a_W = strength * direction / np.linalg.norm(direction)
    failed = {"aborted": False, "lifted": False, "held": False}
    try:
        with Rig(bench, name="shaken_grasp", log_period=0.5) as rig:
            there = rig.commanded("arm.position_commanded")
            there = there - grasp.R_WG @ np.array(grasp.retreat)
            rig.move(there, _ARRIVE)
            rig.advance(_LEAST_CLOSE, closure=1.0, force_limit=limit)
            end = rig.time + _MOST_CLOSE - _LEAST_CLOSE
            while rig.time < end:
                rig.advance(_CHECK)
                if np.abs(rig.measured("gripper.state_measured")[4:8]).max() < _STILL:
                    break
            above = there + np.array([0.0, 0.0, _RISE])
            rig.move(above, _LIFT)
            rig.advance(_REST)
            patches, body = read_grasp(rig.station, rig.context, bench.task.pick)
            if not (is_free(rig) and patches):
                return failed
            before = rig.X_GO().translation()
            rig.advance(_SHAKE, arm=shake(above, a_W, _FREQUENCY, _SHAKE))
            rig.advance(_REST)
            moved = float(np.linalg.norm(rig.X_GO().translation() - before))
            held = is_free(rig) and moved < _LOST
    except ScenarioError:
        return failed | {"aborted": True}
    found: ex.Measures = {"aborted": False, "lifted": True, "held": held}
    for name, measure in MEASURES.items():
        found[name], count = measure(patches, body), 0  # which warms the caches
        start = elapsed = time.process_time()
        while elapsed - start < 5e-3:  # the cheap ones take microseconds
            measure(patches, body)
            count, elapsed = count + 1, time.process_time()
        found[f"cost of {name}"] = 1e3 * (elapsed - start) / count
    return found | {"strength": strength, "moved": moved}


def auc(value: Vector, held: Flags) -> float:
    """Return the AUC of a measure; NaN unless some grasps held and some did not."""
    if held.all() or not held.any():
        return np.nan
    u = mannwhitneyu(value[held], value[~held]).statistic
    return float(u / (held.sum() * (~held).sum()))


def auc_error(area: float, held: Flags) -> float:
    """Return the standard error of an AUC (Hanley, McNeil, Radiology 143:29, 1982)."""
    m, n = int(held.sum()), int((~held).sum())
    if not (m and n):
        return np.nan
    both, same = area / (2.0 - area), 2.0 * area**2 / (1.0 + area)
    spread = area * (1.0 - area)
    spread += (m - 1) * (both - area**2) + (n - 1) * (same - area**2)
    return float(np.sqrt(max(spread, 0.0) / (m * n)))


def auc_by_object(value: Vector, held: Flags, names: Any) -> float:
    """Return the mean AUC over objects with enough held and failed grasps."""
    each = []
    for name in np.unique(names):
        own = names == name
        if min(held[own].sum(), (~held[own]).sum()) >= _FEW:
            each.append(auc(value[own], held[own]))
    return float(np.mean(each)) if each else np.nan


def whole(trials: ex.Trials) -> dict[str, ex.Values]:
    made, lifted = trials.where(aborted=False), trials.where(lifted=True)
    some = ex.number(spread=0.05 * len(made))
    held, names = lifted["held"], lifted["object"]
    found: dict[str, ex.Values] = {
        "all": {
            "shakes []": (len(trials), ex.number(spread=1.0)),
            "objects []": (len(set(made["object"])), ex.number(spread=0.5)),
            "aborted by Drake []": (len(trials) - len(made), ex.number(spread=3.0)),
            "lifted []": (len(lifted), some),
            "held of these []": (sum(held), some),
        }
    }
    for name in MEASURES:
        area = auc(lifted[name], held)
        values = {
            "AUC []": area,
            "AUC, mean of objects []": auc_by_object(lifted[name], held, names),
            "AUC, standard error []": auc_error(area, held),
            "cost [ms]": np.mean(lifted[f"cost of {name}"]),
        }
        # Without enough shakes, there is none.
        found[name] = {what: x for what, x in values.items() if np.isfinite(x)}
    return found


grasp_measures = ex.Experiment(
    "Measures of grasps against simulated shakes: which of them tell what will hold.",
    cases,
    trial,
    {
        "AUC": ex.number(spread=0.1),
        "AUC, mean of objects": ex.number(spread=0.1),
        "AUC, standard error": ex.number(spread=0.03),
        "cost": ex.number(clock="time"),
    },
    whole=whole,
    picture=[ex.Bars(["AUC", "AUC, mean of objects"])],
)
