"""Household objects grasped from above and the side, lifted and shaken at 1 g, 2 Hz.

data/grasps.yaml states how each object is presented and grasped, and why. The hand must
hold objects firmly that fit between the pads. On wider objects, the pads cannot become
parallel. They press on the edges and slip off.
"""

from collections.abc import Sequence

import numpy as np

import experiments.runner as ex
from drake_srg.common.srg_geometry import SRG
from experiments.data import household_objects
from experiments.stands import grasps as stand
from experiments.stands.holding import FULL_FORCE

OPENING = 1e3 * SRG.parallel_gap  # between parallel pads, base links sideways [mm]
SLIP = 5.0  # in the hand, from the lift to the end, of an object that is held [mm]


def cases(objects: Sequence[str] = ()) -> list[ex.Case]:
    wanted = ex.chosen("objects", objects, {name for name, _ in stand.grasps()})
    return [
        {"object": name, "approach": approach}
        for name, approach in stand.grasps()
        if name in wanted
    ]


def trial(object: str, approach: str) -> ex.Measures:
    grasp = stand.grasps()[object, approach]
    found = stand.simulate(stand.present(household_objects()[object], grasp), grasp)
    width = 1e3 * stand.width_between_pads(object, grasp)
    rows = {"slip [mm]": found["slip"], "wire force [N]": found["wire_force"]}
    if width > OPENING:
        rows["too wide: opening needed [mm]"] = width
    else:
        rows["held by the hand alone for [s]"] = found["held_for"]
        rows["turn in the hand [degrees]"] = found["turn"]
    return found | rows


def slip(own: ex.Trials) -> ex.Bound:
    fits = "turn in the hand [degrees]" in own[0]
    return ex.at_most(SLIP) if fits else ex.at_least(SLIP)


household = ex.Experiment(
    "Household objects grasped from above and the side, lifted and shaken at 1 g.",
    cases,
    trial,
    {
        "held by the hand alone for": ex.at_least(stand.HELD),
        "slip": slip,
        "turn in the hand": ex.at_most(10.0),
        "wire force": FULL_FORCE,
        "too wide: opening needed": ex.at_least(OPENING),
        "acceleration of the hand": ex.within(stand.ACCELERATION, relative=0.05),
    },
    by=("object", "approach"),
    whole=lambda trials: {
        "all": {"acceleration of the hand [m/s²]": np.min(trials["acceleration"])}
    },
    picture=[
        ex.Images(
            caption=lambda t: f"slips {t['slip']:.1f} mm, {t['grip_force']:.0f} N"
        )
    ],
)
