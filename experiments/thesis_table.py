"""The five-axis arm's cell compared with the results of its thesis.

Table 1 of the thesis reports ten grasps of a cylinder at one place. One variant repeats
this by the thesis's own rules (localizer, taught waypoints, motions and waits). In the
others, the cylinder stands anywhere in the pick region, and the rules are the thesis's
or ours. Ours must seat every cylinder, and be no worse than the thesis's rules in the
same run.

The arm's forward kinematics are checked at one posture, as in the thesis. Errors in x
and y depend on a camera whose data the thesis does not publish; see `thesis_localizer`.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

import experiments.runner as ex
from drake_srg import Rig, load_scenario
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.theses import arm_kinematics as theirs
from drake_srg.types import Vector
from experiments.stands.cycles import THESIS_PLACE, run_cycle

OURS, FLAT, RULES = "ours", "ours, flat fingertips", "thesis's rules"
AT_PLACE = f"{RULES}, at its place"
_PLACE = f"object.position={THESIS_PLACE[:2].tolist()}"
# Scenario, overrides and most runs: at its place, as many as in the thesis, where only
# the friction differs from run to run.
VARIANTS: Mapping[str, tuple[str, tuple[str, ...], int | None]] = {
    OURS: ("assistive_arm", (), None),
    FLAT: ("assistive_arm_flat", (), None),
    AT_PLACE: ("assistive_arm_thesis", (_PLACE,), 10),
    RULES: ("assistive_arm_thesis", (), None),
}


def cases(seeds: int = 50) -> list[ex.Case]:
    return [
        {"variant": name, "seed": seed}
        for name, (_, _, most) in VARIANTS.items()
        for seed in range(min(seeds, most or seeds))
    ]


def trial(variant: str, seed: int) -> ex.Measures:
    """Run a cycle; errors in mm."""
    scenario, overrides, _ = VARIANTS[variant]
    cycle = run_cycle(scenario, seed, overrides)
    found = dict(cycle)
    # Of every cylinder that was released, seated or not.
    placement = cycle["placement"] if cycle["error_G"] is not None else None
    for what, error in (("placed", placement), ("seen", cycle["localization"])):
        for i, axis in enumerate("xyz"):
            found[f"{what} {axis}"] = None if error is None else 1e3 * error[i]
    return found


# Bounds are the thesis's table 1, or our own where they are tighter: half of the
# recess's clearance, and a cycle of 8 s [mm], [s].
CYCLE = 23.69
_PLACED = {"placed x": 4.0, "placed y": 2.0}
PRINTED = {**_PLACED, "seen x": 0.07, "seen y": 0.07, "seen z": 15.0}
MOST = {
    OURS: PRINTED | {"placed x": 0.5, "placed y": 0.5, "seen z": 0.3},
    FLAT: PRINTED,
    AT_PLACE: _PLACED,
    RULES: _PLACED,
}


def summary(own: ex.Trials) -> ex.Values:
    """Judge a variant by the thesis's table and, if it is ours, by the thesis's rules.

    Cycle time and sightings are reproduced at the thesis's place, not beaten.
    Elsewhere, the tip goes other ways, so the cycle takes another time.
    """

    def average(measure: str, of: ex.Trials = own) -> Any:
        return np.mean(of.known(measure)) if len(of.known(measure)) else np.nan

    def largest(measure: str) -> float:
        return max(np.abs(own.known(measure)), default=np.nan)

    variant, every = own.name, ex.at_least(len(own))
    found: dict[str, Any] = {
        "grasped and lifted []": (sum(own["lifted"]), every),
        "seated in the recess []": (sum(own["placed"]), every),
    }
    for measure, most in MOST[variant].items():
        what, axis = measure.split()
        error = {"placed": "placement", "seen": "localisation"}[what]
        key = f"largest {error} error, {axis} [mm]"
        source = "own" if most < PRINTED[measure] else "thesis"
        found[key] = (largest(measure), ex.at_most(most, source=source))
    if variant in (OURS, FLAT):
        rules, worse = own.whole.where(variant=RULES), "expected: by the thesis's rules"
        found["mean cycle [s]"] = (average("cycle"), ex.at_most(CYCLE, source="thesis"))
        for what, measure, claim in (
            ("mean time to placement; {} [s]", "placing", ex.at_most),
            ("mean smoothness; {} []", "smoothness", ex.at_least),
        ):
            limit = claim(average(measure, rules))
            found[what.format(worse)] = (average(measure), limit)
    if variant == OURS:
        found["longest cycle [s]"] = (largest("cycle"), ex.at_most(8.0))
    if variant == AT_PLACE:
        # P0, P3 and P4 of `assistive_arm_thesis`, which the thesis does not publish,
        # are chosen to give its cycle time.
        bound = ex.within(CYCLE, absolute=0.25, source="thesis")
        found["mean cycle [s]"] = (average("cycle"), bound)
        bound = ex.within(15.0, absolute=0.1, source="thesis")
        found["largest localisation error, z [mm]"] = (largest("seen z"), bound)
    return found


# The thesis's example: joint angles, and the tip's Euler angles as it predicts them and
# as it reads them in CoppeliaSim [degrees].
POSTURE = np.array([10.0, 20.0, 30.0, 40.0, 50.0])
PREDICTED = np.array([-136.3074, -68.1808, -108.777])
SIMULATED = np.array([-136.342, -68.221, -108.737])


def kinematics(trials: ex.Trials) -> dict[str, ex.Values]:
    q = np.deg2rad(POSTURE)
    digit = 1e-4  # of the print's last one [degrees]
    coppelia = ex.at_most(np.max(np.abs(SIMULATED - PREDICTED)), source="thesis")
    printed, section = (
        _largest(predict(theirs.ASSISTIVE_ARM_SCREWS_PRINTED, home, q) - PREDICTED)
        for home in (
            theirs.ASSISTIVE_ARM_HOME_PRINTED,
            theirs.ASSISTIVE_ARM_HOME_SECTION_4_4_3,
        )
    )
    model = predict(theirs.ASSISTIVE_ARM_SCREWS, theirs.ASSISTIVE_ARM_HOME, q)
    simulated = _largest(simulated_angles(q) - model)
    of_print = "appendix A's screws and M against the printed angles"
    of_section = "the same with the M of section 4.4.3; expected: more than that"
    of_arm = "simulated arm against prediction; expected: CoppeliaSim's"
    of_plant = "plant against product of exponentials, 1,000 postures"
    return {
        "forward kinematics": {
            f"{of_print} [degrees]": (printed, ex.at_most(digit, source="thesis")),
            f"{of_section} [degrees]": (section, ex.at_least(digit)),
            f"{of_arm} [degrees]": (simulated, coppelia),
            f"{of_plant} [degrees]": (kinematics_error(), coppelia),
        }
    }


def predict(screws: Vector, home: Vector, q: Vector) -> Vector:
    """Return the tip's Euler angles by the product of exponentials (3) [degrees]."""
    return np.rad2deg(
        theirs.euler_angles(theirs.forward_kinematics(screws, home, q)[:3, :3])
    )


def simulated_angles(q: Vector) -> Vector:
    """Return the tip's Euler angles (3) [degrees] when the arm rests at q (5) [rad].

    It holds it against gravity. Nothing collides: the hand would be in the bench.
    """
    changes = [
        *(f"arm.home={q.tolist()}", "object.present=false"),
        'ignored_contacts=[["*", "*"]]',
    ]
    bench = load_scenario("assistive_arm", seed=0, overrides=changes)
    with Rig(bench, name="thesis_table") as rig:
        rig.advance(3.0)
        return tip_angles(rig.plant, rig.plant_context)


def tip_angles(plant: MultibodyPlant, context: object) -> Vector:
    """Return the Euler angles of the arm's tip in its base (3) [degrees]."""
    arm = plant.GetModelInstanceByName("arm")
    base, tip = (plant.GetFrameByName(name, arm) for name in ("base", "tip"))
    R_BT = plant.CalcRelativeTransform(context, base, tip).rotation().matrix()
    return np.rad2deg(theirs.euler_angles(R_BT))


def kinematics_error() -> float:
    """Return the plant's largest error in 1,000 postures within limits [degrees]."""
    plant = MakeModelsPlant(load_scenario("assistive_arm"))
    context, arm = plant.CreateDefaultContext(), plant.GetModelInstanceByName("arm")
    lower, upper = (
        plant.GetPositionsFromArray(arm, limits)
        for limits in (plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits())
    )
    worst = 0.0
    for q in np.random.default_rng(0).uniform(lower, upper, (1000, len(lower))):
        plant.SetPositions(context, arm, q)
        predicted = predict(theirs.ASSISTIVE_ARM_SCREWS, theirs.ASSISTIVE_ARM_HOME, q)
        worst = max(worst, _largest(tip_angles(plant, context) - predicted))
    return worst


def _largest(difference: Vector) -> float:
    """Return the largest angle (n) [degrees], whole turns aside."""
    return float(np.max(np.abs((difference + 180.0) % 360.0 - 180.0)))


thesis_table = ex.Experiment(
    "The five-axis arm's cell compared with the results of its thesis.",
    cases,
    trial,
    summary=summary,
    whole=kinematics,
    picture=[ex.Points("placed x", "placed y"), ex.Histogram("cycle", limit=CYCLE)],
)
