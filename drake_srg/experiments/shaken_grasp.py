"""One imperfect grasp: close, lift, read the contacts, shake, see whether it holds.

The grasps of data/grasps.yaml are shifted at random, and wire force, friction and mass
are drawn, so that about half of the objects are lost.
"""

from __future__ import annotations

import copy
import dataclasses as dc
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.random import default_rng

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments.data import household_objects
from drake_srg.experiments.grasping import GraspConfig, present
from drake_srg.experiments.household import Case
from drake_srg.objects.household import object_facts
from drake_srg.planning.grasps.grasp_measures import Body, Patch
from drake_srg.simulation.rig import Rig, shake
from drake_srg.station.held_grasp import read_grasp
from drake_srg.types import Vector

# Shift along the palm's x, y, z (never deeper, where the table or the palm is) [m].
_SHIFT_LOW, _SHIFT_HIGH = (
    np.array([0.0, -0.004, -0.012]),
    np.array([0.012, 0.004, 0.012]),
)
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
LOST = 0.015  # motion in the hand that loses the object [m]


@dc.dataclass(frozen=True, eq=False)
class ShakenGrasp:
    """A grasp and what became of it.

    Attributes:
        seed: Of its draws.
        lifted: Whether the hand alone held the object after the lift.
        survived: Whether it still did after the shake, without much motion.
        patches: The contacts after the lift, before the shake.
        body: The object then.
        strength: Of the shake [m/s²].
        moved: Motion in the hand during the shake [m].
    """

    seed: int
    lifted: bool
    survived: bool
    patches: list[Patch]
    body: Body
    strength: float
    moved: float


def shaken_grasp(
    case: Case, seed: int, scenario: str = "gripper_bench_fast"
) -> ShakenGrasp:
    """Grasp, lift and shake an object.

    Args:
        case: The object and its proper grasp.
        seed: Of the draws.
        scenario: The bench.

    Raises:
        ScenarioError: If Drake aborts the simulation.
    """
    rng = default_rng([seed, sum(map(ord, str(case)))])
    grasp, thing, force = _drawn(case, rng)
    bench = present(thing, grasp, scenario)
    motor = None if bench.gripper is None else bench.gripper.wire_motor
    if motor is None:
        raise ScenarioError("gripper: a grasp experiment needs !SrgTendonDriver")
    direction = rng.normal(size=3)
    strength = float(rng.uniform(*_STRENGTH))
    a_W = strength * direction / np.linalg.norm(direction)
    limit = motor.drive.force_limit_of(force)
    with Rig(bench, name="shaken_grasp", log_period=0.5) as rig:
        there = rig.commanded("arm.position_commanded")
        there = there - grasp.R_WG @ np.array(grasp.retreat)
        rig.move(there, _ARRIVE)
        _close(rig, limit)
        above = there + np.array([0.0, 0.0, _RISE])
        rig.move(above, _LIFT)
        rig.advance(_REST)
        patches, body = read_grasp(rig.station, rig.context, rig.scenario.task.pick)
        lifted = set(rig.contact_forces()) == {"gripper"}
        if not lifted:
            return ShakenGrasp(seed, False, False, patches, body, strength, np.nan)
        before = rig.X_GO().translation()
        rig.advance(_SHAKE, arm=shake(above, a_W, _FREQUENCY, _SHAKE))
        rig.advance(_REST)
        moved = float(np.linalg.norm(rig.X_GO().translation() - before))
        held = set(rig.contact_forces()) == {"gripper"}
    survived = held and moved < LOST
    return ShakenGrasp(seed, True, survived, patches, body, strength, moved)


def _close(rig: Rig, force_limit: float) -> None:
    """Close the hand and wait until its joints stand still."""
    rig.advance(_LEAST_CLOSE, closure=1.0, force_limit=force_limit)
    end = rig.time + _MOST_CLOSE - _LEAST_CLOSE
    while rig.time < end:
        rig.advance(_CHECK)
        if np.abs(rig.measured("gripper.state_measured")[4:8]).max() < _STILL:
            break


def _drawn(case: Case, rng: np.random.Generator) -> tuple[GraspConfig, Any, float]:
    """Return a shifted grasp, a changed object and a wire force [N]."""
    shift = rng.uniform(_SHIFT_LOW, _SHIFT_HIGH)
    # In the palm, a shallower grasp has the object farther out.
    grip = np.array(case.grasp.grip) + shift
    retreat = _RETREAT * np.array(case.grasp.retreat)
    grasp = dc.replace(case.grasp, grip=list(grip), retreat=list(retreat))
    thing = copy.deepcopy(household_objects()[case.name])
    mass = thing.mass or object_facts(case.name, thing).mass
    thing.mass = mass * float(np.exp(rng.uniform(*np.log(_MASS))))
    thing.friction = float(rng.uniform(*_FRICTION))
    force = grasp.wire_force * float(np.exp(rng.uniform(*np.log(_FORCE))))
    return grasp, thing, force


def to_json(made: ShakenGrasp) -> dict[str, Any]:
    """Return a grasp as numbers, lists and names, for a file of finished trials."""
    plain = dc.asdict(made)
    plain["patches"] = [
        {key: _plain(value) for key, value in dc.asdict(patch).items()}
        for patch in made.patches
    ]
    plain["body"] = {key: _plain(value) for key, value in plain["body"].items()}
    return plain


def from_json(plain: Mapping[str, Any]) -> ShakenGrasp:
    """Return the grasp of `to_json`."""
    patches = [Patch(**_arrays(patch)) for patch in plain["patches"]]
    body = Body(**_arrays(plain["body"]))
    return ShakenGrasp(**{**plain, "patches": patches, "body": body})


def _plain(value: float | Vector) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _arrays(plain: Mapping[str, Any]) -> dict[str, Any]:
    return {k: np.array(v) if isinstance(v, list) else v for k, v in plain.items()}
