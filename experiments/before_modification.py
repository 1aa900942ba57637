"""The fingertips or the tip frame: which change repaired the first five-axis arm.

The thesis of the five-axis arm began with flat, hard, smooth fingertips and an
uncorrected tip frame. It reports frequent failures and a constant offset. With curved
fingertips and a moved tip frame, it reports ten of ten grasps.

Here, the cylinder stands anywhere in the pick region, and the arm picks it by the
thesis's rules. The trials combine flat or curved pads, hard plastic or rubber, the
friction between pad and cylinder, and the tip frame as drawn or corrected. With either
tip frame, the taught poses P3 and P4 lead to the same places.
"""

import json
import re
import tempfile
from pathlib import Path

import numpy as np

import experiments.runner as ex
from drake_srg.parsing import models_path
from drake_srg.scenario import load_scenario
from drake_srg.scenario.load import load_tree
from experiments.stands.cycles import placed_interval, run_cycle, shares

SCENARIO = "assistive_arm_fast"
AS_DRAWN, CORRECTED = "as drawn", "corrected"
# The scenario that has the waypoints taught with each tip.
TIPS = {AS_DRAWN: "assistive_arm_before", CORRECTED: "assistive_arm_thesis"}
FRICTION = (0.1, 0.2, 0.3, 0.4, 0.6, 0.8)
# The cylinder's own friction, the middle of the scenario's range, and its modulus, the
# package's default for objects: much stiffer than rubber, so that the pads' hardness
# counts.
_OBJECT_FRICTION = 0.65
_OBJECT = (f"object.friction={_OBJECT_FRICTION}", "object.modulus=5.0e+7")
# The thesis's waypoints, motions and waits until it has let the cylinder go.
_RULES = ("lift", "place", "tip_limits", "grip_wait", "release_wait")

# The models that the shapes, and the materials, are taken from.
SHAPES = {"flat": "linkage_gripper_bare", "curved": "linkage_gripper_fast"}
MATERIALS = {"hard": "linkage_gripper_bare", "rubber": "linkage_gripper_fast"}
LEVELS = {"tip": TIPS, "shape": SHAPES, "material": MATERIALS, "friction": FRICTION}
_PAD = re.compile(
    r'(<collision name="(master|slave)_pad.*?<drake:proximity_properties>)(.*?)'
    r"(</drake:proximity_properties>)",
    re.DOTALL,
)
_MU = re.compile(r"(<drake:mu_(?:dynamic|static)>)[^<]*")


def gripper_sdf(shape: str, material: str, friction: float) -> str:
    """Return the SDF of a gripper with such pads.

    With Drake's rule, the harmonic mean of both, they have `friction` on the cylinder.
    """

    def sdf(name: str) -> str:
        return (models_path() / "sdf" / f"{name}.sdf").read_text(encoding="utf-8")

    own = friction * _OBJECT_FRICTION / (2.0 * _OBJECT_FRICTION - friction)
    contact = {pad[2]: pad[3] for pad in _PAD.finditer(sdf(MATERIALS[material]))}

    def change(pad: re.Match[str]) -> str:
        return pad[1] + _MU.sub(rf"\g<1>{own:.6f}", contact[pad[2]]) + pad[4]

    return _PAD.sub(change, sdf(SHAPES[shape]))


def overrides(tip: str, seed: int, model: Path) -> list[str]:
    """Return a trial as overrides of `SCENARIO`.

    The camera hangs straight above the cylinder. There, the thesis's rule errs in the
    plane as little as the thesis prints (0.07 mm), and not by the 2 mm that the rule
    makes with our camera, which hangs between the tables.
    """
    tree = load_tree(TIPS[tip])
    place = load_scenario(SCENARIO, seed=seed).objects["cylinder"].position or ()
    camera = tree["cameras"]["ceiling"]
    height = camera["X_PB"]["translation"][2]
    rules = {
        "arm.home": tree["arm"]["home"],
        "cameras.ceiling": camera,
        "cameras.ceiling.X_PB.translation": [*place, height],
        "localizer": tree["localizer"],
        "planner": {
            **load_tree(SCENARIO)["planner"],
            **{key: tree["planner"][key] for key in ("_tag", *_RULES)},
        },
        # A multiple of 1/1024 s, as this integrator needs it.
        "localizer.thesis.period": 0.046875,
        "directives.gripper.add_model.file": model.as_uri(),
    }
    if tip == AS_DRAWN:
        (own,) = (d for d in tree["directives"] if "add_directives" in d)
        rules["directives.assistive_arm_fast_tip"] = own
    return [*_OBJECT, *(f"{key}={json.dumps(value)}" for key, value in rules.items())]


def cases(trials: int = 5) -> list[ex.Case]:
    return ex.grid(**LEVELS, seed=range(trials))


def trial(
    tip: str, shape: str, material: str, friction: float, seed: int
) -> ex.Measures:
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / "linkage_gripper.sdf"
        model.write_text(gripper_sdf(shape, material, friction), encoding="utf-8")
        return run_cycle(SCENARIO, seed, overrides(tip, seed, model))


def whole(trials: ex.Trials) -> dict[str, ex.Values]:
    """Return success rates by level of each factor, and by case.

    Expect the corrected tip to pay beyond doubt: its interval lies above that of the
    tip as drawn, whatever the pads.
    """
    found: dict[str, ex.Values] = {
        f"{factor} {level}": shares(trials.where(**{factor: level}))
        for factor, levels in LEVELS.items()
        for level in levels
    }
    some = ex.number(spread=0.2)
    named = "{shape}, {material}, friction {friction:g}, tip {tip}"
    for own in trials.groups("shape", "material", "tip").values():
        name = "{shape}, {material}, tip {tip}".format_map(own[0])
        off = own.known("distance")
        found[name] = ex.quantiles("distance from the goal", "mm", off)
    for own in trials.groups("shape", "material", "friction", "tip").values():
        found[named.format_map(own[0])] = {
            "grasped and lifted, share []": (np.mean(own["lifted"]), some),
            "placed, share []": (np.mean(own["placed"]), some),
        }
    least, _ = placed_interval(trials.where(tip=CORRECTED))
    _, most = placed_interval(trials.where(tip=AS_DRAWN))
    what = "placed: least share; expected: most as drawn []"
    found[f"tip {CORRECTED}"][what] = (least, ex.at_least(most, spread=0.05))
    return found


before_modification = ex.Experiment(
    "Fingertips or tip frame: which change repaired the first five-axis arm.",
    cases,
    trial,
    whole=whole,
    picture=[
        ex.Bars(["placed, share"], [f"{f} {v}" for f, vs in LEVELS.items() for v in vs])
    ],
)
