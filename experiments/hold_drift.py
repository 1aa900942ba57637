"""Creep of a held can and box, by step, contact approximation and stiction tolerance.

With regularised contact, anything held by friction slides slowly, at a rate that the
solver's settings determine. Users of MuJoCo report 50 to 2,300 um/s.
"""

from collections.abc import Mapping

import numpy as np

import experiments.runner as ex
from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import object_facts
from drake_srg.objects.models import simple_shape
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Box, Vector
from experiments.data import household_objects

BENCH = "gripper_bench"
ACCURATE, FAST = f"{BENCH}_accurate", f"{BENCH}_fast"
# Scenario and changes.
SETTINGS: dict[str, tuple[str, dict[str, object]]] = {
    ACCURATE: (ACCURATE, {}),
    FAST: (FAST, {}),
    f"{BENCH}: sap, 2 ms": (BENCH, {}),
    "sap, 1 ms": (BENCH, {"plant_config.time_step": 0.001, "arm.period": 0.001}),
    "sap, 5 ms": (BENCH, {"plant_config.time_step": 0.005, "arm.period": 0.005}),
    **{
        f"{approximation}, 2 ms, {stiction:g} m/s": (
            BENCH,
            {
                "plant_config.discrete_contact_approximation": approximation,
                "plant_config.stiction_tolerance": stiction,
            },
        )
        for approximation, stiction in (
            *(("sap", 1e-3), ("lagged", 1e-3), ("lagged", 1e-4), ("lagged", 1e-5)),
            ("similar", 1e-4),
        )
    },
}


def things() -> dict[str, tuple[ObjectConfig, float]]:
    """Return the standing can and sugar box, and the palm's height above the table [m].

    Both are grasped from above with their tops at the roots of the pads.
    """
    objects = household_objects()
    can, sugar = objects["005_tomato_soup_can"], objects["004_sugar_box"]
    shape = simple_shape("sugar_box", sugar)
    assert isinstance(shape, Box)
    x, height, y = shape.size  # on its end, the thin side between the fingers
    mass = object_facts("sugar_box", sugar).mass
    box = ObjectConfig(shape=Box([x, y, height]), mass=mass, friction=0.6)
    return {"can": (can, 0.1018 + 0.118), "box": (box, height + 0.118)}


def creep(
    thing: ObjectConfig,
    height: float,
    scenario: str,
    changes: Mapping[str, object],
    duration: float,
    force_limit: float,
) -> tuple[Vector, Vector]:
    """Grasp an object, lift it, and measure its motion in the hand.

    Args:
        thing: The object.
        height: Of the palm above the table at the grasp [m].
        scenario: The bench.
        changes: Overrides of the bench.
        duration: Of the hold [s].
        force_limit: Of the servo.

    Returns:
        Time, shape (K,) [s], and distance in the palm frame from the position at the
        start of the hold, shape (K,) [m].

    Raises:
        ScenarioError: If the hand does not hold the object after the lift.
    """
    bench = bench_scenario(
        thing,
        home=[0.0, 0.0, height],
        scenario=scenario,
        overrides=[f"{key}={value}" for key, value in changes.items()],
    )
    with Rig(bench, name="hold_drift") as rig:
        rig.advance(3.5, closure=1.0, force_limit=force_limit)
        rig.move([0.0, 0.0, height + 0.06], 1.0)
        rig.advance(1.0)  # until motion from the lift has settled
        start = rig.time
        touching = set(rig.contact_forces())
        if touching != {"gripper"}:
            raise ScenarioError(
                f"hold_drift: {scenario}: the hand holds nothing; the object touches "
                f"{', '.join(sorted(touching)) or 'nothing'}"
            )
        rig.advance(duration)
        log = rig.log()
    held = log["time"] >= start - 1e-6
    # The gantry only translates: object minus hand is the motion in the hand.
    p_GO = log["object_pose.thing"][held, :3] - log["arm.state_measured"][held, :3]
    return log["time"][held] - start, np.linalg.norm(p_GO - p_GO[0], axis=1)


def cases(duration: float = 10.0, force_limit: float = 0.5) -> list[ex.Case]:
    """Hold both objects with every setting.

    Args:
        duration: Of the hold [s].
        force_limit: Of the servo; 0.5 gives 154 N per wire, a firm grip of the box,
            whose weight is 5 N.
    """
    return ex.grid(
        thing=("can", "box"),
        setting=SETTINGS,
        duration=[duration],
        force_limit=[force_limit],
    )


def trial(thing: str, setting: str, duration: float, force_limit: float) -> ex.Measures:
    _, moved = creep(*things()[thing], *SETTINGS[setting], duration, force_limit)
    return {f"creep over {duration:g} s [um/s]": moved[-1] / duration * 1e6}


hold_drift = ex.Experiment(
    "Creep of a held can and box, by step, approximation and stiction tolerance.",
    cases,
    trial,
    {
        "creep over 10 s": {
            f"{thing}, {ACCURATE}": ex.at_most(3.0) for thing in ("can", "box")
        }
    },
    by=("thing", "setting"),
    picture=[ex.Bars(["creep over 10 s"], log=True)],
)
