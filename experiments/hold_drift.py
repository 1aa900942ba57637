"""Creep of a held can and box, by step, contact approximation and stiction tolerance.

With regularised contact, anything held by friction slides slowly, at a speed that
depends on the solver's settings. Users of MuJoCo report 50 to 2,300 um/s.
"""

from collections.abc import Sequence

import numpy as np

import experiments.runner as ex
from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import object_facts
from drake_srg.objects.models import simple_shape
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Box
from experiments.data import household_objects
from experiments.stands.holding import in_hand, is_free

BENCH = "gripper_bench"
ACCURATE, FAST = f"{BENCH}_accurate", f"{BENCH}_fast"
# Scenario and overrides.
SETTINGS: dict[str, tuple[str, tuple[str, ...]]] = {
    ACCURATE: (ACCURATE, ()),
    FAST: (FAST, ()),
    f"{BENCH}: sap, 2 ms": (BENCH, ()),
    "sap, 1 ms": (BENCH, ("plant_config.time_step=0.001", "arm.period=0.001")),
    "sap, 5 ms": (BENCH, ("plant_config.time_step=0.005", "arm.period=0.005")),
} | {
    f"{approximation}, 2 ms, {stiction:g} m/s": (
        BENCH,
        (
            f"plant_config.discrete_contact_approximation={approximation}",
            f"plant_config.stiction_tolerance={stiction}",
        ),
    )
    for approximation, stiction in (
        *(("sap", 1e-3), ("lagged", 1e-3), ("lagged", 1e-4), ("lagged", 1e-5)),
        ("similar", 1e-4),
    )
}
HOLD = 10.0  # s
_FIRM = 0.5  # force limit: 154 N per wire, a firm grip of the box, whose weight is 5 N


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
    thing: str,
    scenario: str,
    overrides: Sequence[str],
    force_limit: float,
    duration: float = HOLD,
) -> float:
    """Grasp a thing on a bench, lift it, and return how fast it moves [um/s].

    Raises:
        ScenarioError: If the hand does not hold it after the lift.
    """
    config, height = things()[thing]
    bench = bench_scenario(
        config, home=[0.0, 0.0, height], scenario=scenario, overrides=overrides
    )
    with Rig(bench, name="hold_drift") as rig:
        rig.advance(3.5, closure=1.0, force_limit=force_limit)
        rig.move([0.0, 0.0, height + 0.06], 1.0)
        rig.advance(1.0)  # until motion from the lift has settled
        if not is_free(rig):
            raise ScenarioError(f"hold_drift: {scenario}: the hand holds nothing")
        start = len(rig.log()["time"]) - 1
        rig.advance(duration)
        p_GO = in_hand(rig.log())
    return 1e6 * float(np.linalg.norm(p_GO[-1] - p_GO[start])) / duration


hold_drift = ex.Experiment(
    "Creep of a held can and box, by step, approximation and stiction tolerance.",
    lambda: ex.grid(thing=("can", "box"), setting=SETTINGS),
    lambda thing, setting: {
        f"creep over {HOLD:g} s [um/s]": creep(thing, *SETTINGS[setting], _FIRM)
    },
    {
        f"creep over {HOLD:g} s": {
            f"{thing}, {ACCURATE}": ex.at_most(3.0) for thing in ("can", "box")
        }
    },
    by=("thing", "setting"),
    picture=[ex.Bars([f"creep over {HOLD:g} s"], log=True)],
)
