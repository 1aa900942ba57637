"""Whether resting objects that sleep save time, and change no outcome.

In each scene, a carton at rest is pushed into things that stand and lie on a table. It
is simulated with all objects awake and with objects that sleep until something comes
near.
"""

from __future__ import annotations

import dataclasses as dc
import time as wall
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex

from drake_srg.experiments.data import household_objects
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.objects.config import ObjectConfig, SleepingConfig
from drake_srg.objects.models import object_body
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.scenario import Scenario
from drake_srg.simulation.rig import Rig, tabletop
from drake_srg.types import Box, Cylinder, Vector

SLEEPING = SleepingConfig()
# The carton is pushed when everything sleeps, and has come to rest at the end [s].
PUSH, PUSHED_FOR, END = 1.1, 0.1, 1.6
MOVED, FELL = 0.005, np.deg2rad(45.0)  # an object moved [m], or fell over [rad]
AWAKE, ASLEEP, HALF = "awake", "asleep", "half the step"
_QUICK = 30
# Half the step is compared in every so many scenes.
_EVERY = 10
_AT_REST = ("005_tomato_soup_can", "mug", "bowl", "squeeze_bottle", "wrench")
_MANY = 40
_COST = 2.0  # simulated time over which the cost is measured [s]
_CHAOTIC = "pushes are chaotic; half the step changes a larger share"


@dc.dataclass(frozen=True)
class Outcome:
    """Where the objects of a scene end.

    Attributes:
        moved: How far each object has moved (N, 3) [m].
        tilt: Angle by which each object has tilted (N) [rad].
        slept: Number of objects that slept just before the push.
    """

    moved: Vector
    tilt: Vector
    slept: int

    @property
    def words(self) -> tuple[str, ...]:
        """What happened to each object: `stayed`, `moved` or `fell`."""
        distance = np.linalg.norm(self.moved, axis=1)
        return tuple(
            "fell" if t > FELL else "moved" if d > MOVED else "stayed"
            for d, t in zip(distance, self.tilt, strict=True)
        )


# Outcomes by the kind of simulation and the seed.
Outcomes = Mapping[str, dict[int, Outcome]]


def scene(seed: int) -> tuple[dict[str, ObjectConfig], float]:
    """Return the objects of a scene and the force of the push along x [N].

    The carton comes first. The others are ahead of it, none in contact with another.
    """
    rng = np.random.default_rng(seed)

    def at(x: float, y: float) -> list[float]:
        return [x, y + float(rng.uniform(-0.04, 0.04))]

    common: dict[str, Any] = {"friction": 0.6, "mass": float(rng.uniform(0.1, 0.4))}
    objects = {
        "carton": ObjectConfig(
            shape=Box([0.06, 0.08, 0.05]), mass=0.4, friction=0.4, position=[0.3, 0.0]
        ),
        "can": ObjectConfig(
            shape=Cylinder(0.033, float(rng.uniform(0.05, 0.1))),
            position=at(float(rng.uniform(0.38, 0.46)), 0.0),
            **common,
        ),
        "block": ObjectConfig(
            shape=Box([0.05, 0.05, float(rng.uniform(0.03, 0.1))]),
            position=at(float(rng.uniform(0.52, 0.58)), 0.03),
            yaw=float(rng.uniform(0.0, 1.5)),
            **common,
        ),
    }
    return objects, float(rng.uniform(5.0, 12.0))


def simulate(seed: int, kind: str) -> Outcome:
    """Simulate a scene: `AWAKE`, `ASLEEP`, or awake with `HALF` the step."""
    objects, force = scene(seed)
    scenario = tabletop(objects, SLEEPING if kind == ASLEEP else None)
    if kind == HALF:
        scenario.plant_config.time_step *= 0.5
    rig = Rig(scenario, name="sleeping", period=0.05, log_period=0.5)
    rig.advance(PUSH)
    slept = sum(_body(rig, n).is_locked(rig.plant_context) for n in objects)
    start = [rig.X_WO(name) for name in objects]
    forces = rig.diagram.GetInputPort("object_forces_cheat")
    push = ExternallyAppliedSpatialForce()
    push.body_index = _body(rig, "carton").index()
    push.F_Bq_W = SpatialForce(tau=np.zeros(3), f=[force, 0.0, 0.0])
    forces.FixValue(rig.context, AbstractValue.Make([push]))
    rig.advance(PUSHED_FOR)
    push.F_Bq_W = SpatialForce(tau=np.zeros(3), f=np.zeros(3))
    forces.FixValue(rig.context, AbstractValue.Make([push]))
    rig.advance(END - PUSH - PUSHED_FOR)
    end = [rig.X_WO(name) for name in objects]
    turned = [
        (a.rotation().col(2) @ b.rotation().col(2))
        for a, b in zip(start, end, strict=True)
    ]
    return Outcome(
        np.array([b.translation() for b in end])
        - np.array([a.translation() for a in start]),
        np.arccos(np.clip(turned, -1.0, 1.0)),
        slept,
    )


def _body(rig: Rig, name: str) -> Any:
    index = object_body(rig.plant, rig.plant.GetModelInstanceByName(name))
    assert isinstance(index, BodyIndex)
    return rig.plant.get_body(index)


def cost(scenario: Scenario) -> float:
    """Return processor time over simulated time once everything is at rest."""
    rig = Rig(scenario, name="sleeping", log_period=0.5)
    rig.advance(1.5)
    start = wall.process_time()
    rig.advance(_COST)
    return (wall.process_time() - start) / _COST


def at_rest(count: int) -> dict[str, ObjectConfig]:
    """Return that many objects at rest, some of each kind, apart from each other."""
    things = household_objects()
    boxes = {"box": ObjectConfig(shape=Box([0.09, 0.17, 0.04]), mass=0.5, friction=0.6)}
    kinds = [*(things[name] for name in _AT_REST), *boxes.values()]
    return {
        f"thing_{i}": dc.replace(
            kinds[i % len(kinds)],
            position=[-0.25 + 0.2 * (i % 7), -0.65 + 0.22 * (i // 7)],
        )
        for i in range(count)
    }


def run(track: Track, *, seeds: int = 300, quick: bool = False) -> ExperimentResult:
    """Measure the cost of objects at rest, then push cartons in many scenes.

    Args:
        track: Shows progress.
        seeds: Number of scenes.
        quick: Whether to simulate 30 scenes only.
    """
    count = _QUICK if quick else seeds
    costs = {
        (n, kind): cost(tabletop(at_rest(n), SLEEPING if kind == ASLEEP else None))
        for n in (6, _MANY)
        for kind in (AWAKE, ASLEEP)
    }
    outcomes: Outcomes = {AWAKE: {}, ASLEEP: {}, HALF: {}}
    for seed in track(range(count), lambda seed: f"scene {seed}"):
        for kind, found in outcomes.items():
            if kind != HALF or seed % _EVERY == 0:
                found[seed] = simulate(seed, kind)
    return ExperimentResult(
        judge(costs, outcomes), {"scenes": columns(outcomes)}, draw(costs, outcomes)
    )


def distances(outcomes: Outcomes, kind: str) -> Vector:
    """Return how far each scene ends from the same one awake, at most [m]."""
    return np.array(
        [
            np.linalg.norm(o.moved - outcomes[AWAKE][seed].moved, axis=1).max()
            for seed, o in outcomes[kind].items()
        ]
    )


def judge(costs: Mapping[tuple[int, str], float], outcomes: Outcomes) -> list[Row]:
    """Expect half the cost and the same outcomes, within what half the step changes."""
    rows = [
        Row.at_most(
            "6 objects",
            "cost asleep over cost awake",
            0.5,
            costs[6, ASLEEP] / costs[6, AWAKE],
            "",
        )
    ]
    for (n, kind), value in costs.items():
        name, quantity = f"{n} objects", f"{kind}, real-time factor"
        rows.append(Row.info(name, quantity, 1.0 / value, "", clock="rate"))
    asleep = outcomes[ASLEEP].values()
    slept = sum(o.slept == len(o.words) for o in asleep) / len(asleep)
    rows.append(Row.at_least(ASLEEP, "scenes in which all slept", 1.0, slept, ""))
    quantity = "scenes that end otherwise"
    others = {
        kind: sum(
            o.words != outcomes[AWAKE][s].words for s, o in outcomes[kind].items()
        )
        for kind in (ASLEEP, HALF)
    }
    shares = {kind: other / len(outcomes[kind]) for kind, other in others.items()}
    units = {kind: f"of {len(outcomes[kind])}" for kind in others}
    row = Row.at_most(
        f"awake and {ASLEEP}", quantity, 0.0, others[ASLEEP], units[ASLEEP]
    )
    rows += [
        row.because(_CHAOTIC) if shares[ASLEEP] < shares[HALF] else row,
        Row.info(f"awake and {HALF}", quantity, others[HALF], units[HALF], spread=3.0),
    ]
    for share, word in ((0.5, "median"), (0.95, "95th percentile")):
        half, measured = (
            1e3 * float(np.quantile(distances(outcomes, kind), share))
            for kind in (HALF, ASLEEP)
        )
        quantity = f"difference of positions, {word}, at most with half the step"
        rows.append(Row.at_most("awake and asleep", quantity, half, measured, "mm"))
    largest = 1e3 * float(distances(outcomes, ASLEEP).max())
    rows.append(
        Row.info(
            "awake and asleep",
            "difference of positions, largest",
            largest,
            "mm",
            spread=largest,  # of one can that rolls
        )
    )
    return rows


def columns(outcomes: Outcomes) -> dict[str, list[Any]]:
    """Return a line of the table for each scene and simulation."""
    table: dict[str, list[Any]] = {}
    for kind, found in outcomes.items():
        for (seed, outcome), d in zip(
            found.items(), distances(outcomes, kind), strict=True
        ):
            for column, value in (
                ("seed", seed),
                ("simulated", kind),
                ("outcome", " ".join(outcome.words)),
                ("difference [mm]", 1e3 * float(d)),
            ):
                table.setdefault(column, []).append(value)
    return table


def draw(costs: Mapping[tuple[int, str], float], outcomes: Outcomes) -> Any:
    """Draw the cost beside the differences of the objects' last positions."""
    figure = make_figure(9.0, 3.2, "Objects that sleep")
    left, right = figure.subplots(1, 2, width_ratios=[1, 2])
    style_axes(left, ylabel="processor time / simulated time")
    labels = [f"{n}\n{kind}" for n, kind in costs]
    left.bar(labels, list(costs.values()), 0.6, color=[COLORS[1], COLORS[0]] * 2)
    left.set_yscale("log")
    style_axes(
        right, xlabel="largest difference of a position [mm]", ylabel="scenes [%]"
    )
    for kind in (ASLEEP, HALF):
        found = np.sort(distances(outcomes, kind))
        share = 100.0 * (np.arange(len(found)) + 1) / len(found)
        right.step(1e3 * np.maximum(found, 1e-7), share, label=f"awake and {kind}")
    right.set_xscale("log")
    right.legend(fontsize=8, frameon=False)
    return figure
