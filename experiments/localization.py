"""Accuracy of the five-axis cell's camera in locating its standing or lying cylinder.

The scenario's ceiling camera and localizer locate the cylinder in many poses, with
images of three sizes. Then the cameras of both varied scenarios look at scenes with
other lights, noise, clutter and occlusion. Only images are simulated, no motion.

`thesis_localizer` compares the rule of the five-axis arm's thesis, which does not know
the shape: it takes the middle of a blob and the depth of one pixel plus 10 mm. Both
localizers look at the thesis's place with three cameras, and all over the pick region
with our camera.
"""

import dataclasses as dc
import functools
from collections.abc import Iterator
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

import experiments.runner as ex
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.theses.blob_localizer import ThesisBlobConfig
from drake_srg.types import BlobFlag, Cylinder
from experiments.stands.cycles import THESIS_PLACE
from experiments.stands.scenes import Eye, angle_between_axes

SCENARIO, CAMERA = "assistive_arm", "ceiling"
STANDING, RECESS, TILTED, LYING = "standing", "in the recess", "tilted", "lying"
UPRIGHT = (STANDING, RECESS)
SIZES = {"320 x 240": (320, 240), "640 x 480": (640, 480), "1280 x 960": (1280, 960)}
OWN = "640 x 480"  # the scenario's size, which is judged
# Where the thesis's blob detection saw its cylinder (its table) [mm from the truth].
PRINTED = 1e3 * (np.array([-0.325013, -0.175051, 0.139989]) - THESIS_PLACE)
_RECESS_DEPTH = 0.005  # m
_PLAY = 0.7e-3  # in the recess, on both axes; less than its clearance [m]
# Scenarios, and the greatest error of position with which the object can be picked
# [mm]: half of what the kitchen's goal allows, and what the five-axis arm's open
# fingers allow.
WITHIN = {"kitchen_varied": 3.0, "assistive_arm_varied": 1.5}
ANOTHER = 20.0  # a sighting farther off shows another thing [mm]
# Standing places along each side of the pick region and in the recess; tilted places,
# lying ones, and scenes of each varied scenario.
_SIDE, _OTHERS = 9, 60


@functools.cache
def load(size: str) -> Scenario:
    sides = zip(("width", "height"), SIZES[size], strict=True)
    changes = [f"cameras.{CAMERA}.{key}={value}" for key, value in sides]
    return load_scenario(SCENARIO, seed=0, overrides=changes)


eye = functools.lru_cache(maxsize=1)(lambda size: Eye(load(size)))


def poses(scenario: Scenario, way: str) -> Iterator[RigidTransform]:
    """Yield poses X_WO of the cylinder all over the pick region, or in the recess."""
    rng = np.random.default_rng(0)
    shape, region = scenario.objects[scenario.task.pick].shape, scenario.task.region
    assert isinstance(shape, Cylinder)
    assert region is not None
    if way == STANDING:
        sides = np.linspace(region.min, region.max, _SIDE).T
        places = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
    elif way == RECESS:
        places = rng.uniform(-_PLAY, _PLAY, (_SIDE, 2)) + scenario.task.place.position
    else:
        places = rng.uniform(region.min, region.max, (_OTHERS, 2))
    tilts = np.zeros(len(places))
    if way not in UPRIGHT:
        tilts = rng.uniform(0.0 if way == TILTED else np.pi / 2, np.pi / 2, _OTHERS)
    for place, tilt in zip(places, tilts, strict=True):
        azimuth = rng.uniform(-np.pi, np.pi)
        level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        axis = np.sin(tilt) * level + [0.0, 0.0, np.cos(tilt)]
        height = 0.5 * shape.length * np.cos(tilt) + shape.radius * np.sin(tilt)
        height += scenario.table.height - (_RECESS_DEPTH if way == RECESS else 0.0)
        R_WO = RotationMatrix.MakeFromOneVector(axis, 2)
        yield RigidTransform(R_WO, [*place, height])


def cases(scenes: int = 60) -> list[ex.Case]:
    """Locate a cylinder in many places with images of three sizes, then in scenes.

    Args:
        scenes: Scenes of each varied scenario.
    """
    sizes = ex.grid(size=SIZES, way=(STANDING, RECESS, TILTED, LYING))
    known = [{"name": f"{c['way']}, {c['size']}", **c, "seed": None} for c in sizes]
    at_place = {"name": "at the thesis's place", "size": OWN, "way": "thesis"}
    return [*known, at_place | {"seed": None}] + [
        {"name": f"{scenario}, {scenes} scenes", "size": "", "way": scenario}
        | {"seed": seed}
        for scenario in WITHIN
        for seed in range(scenes)
    ]


def trial(name: str, size: str, way: str, seed: int | None) -> ex.Measures:
    """Look at the cylinder in every pose of a case, or at a scene."""
    if seed is not None:
        looker = Eye(load_scenario(way, seed=seed))
        found = looker.blobs()
        if not found:
            return {"distance": None, "certain": False}
        off = found[0].position - looker.pose().translation()
        certain = BlobFlag.UNCERTAIN not in found[0].flags
        return {"distance": 1e3 * np.linalg.norm(off), "certain": certain}
    places = [RigidTransform(THESIS_PLACE)]
    if way != "thesis":
        places = list(poses(load(size), way))
    errors, turns, tilts = [], [], []
    for X_WO in places:
        blobs, axis = eye(size).blobs(X_WO), X_WO.rotation().matrix()[:, 2]
        tilts.append(np.rad2deg(np.arccos(min(1.0, axis[2]))))
        seen = len(blobs) == 1  # a second blob would show something else
        error = blobs[0].position - X_WO.translation() if seen else np.full(3, np.nan)
        errors.append(1e3 * np.abs(error))
        turn = angle_between_axes(blobs[0].axis, axis) if seen else np.nan
        turns.append(np.rad2deg(turn))
    return {
        "error": np.max(errors, axis=0),
        "distances": np.linalg.norm(errors, axis=1),
        "rms": np.sqrt(np.mean(np.sum(np.square(errors), axis=1))),
        "turns": turns,
        "tilts": tilts,
    }


def by_axis(what: str, errors: Any, bounds: Any) -> ex.Values:
    return {
        f"{what.format(axis=axis)} [mm]": (error, bound)
        for axis, error, bound in zip("xyz", errors, bounds, strict=True)
    }


def no_worse(errors: Any) -> ex.Values:
    bounds = [ex.at_most(theirs, source="thesis") for theirs in abs(PRINTED)]
    return by_axis("error in {axis}; expected: the thesis's", errors, bounds)


def summary(own: ex.Trials) -> ex.Values:
    """Judge the thesis's place, the scenario's own size and scenes; report others."""
    way, t = own[0]["way"], own[0]
    if way in WITHIN:
        return of_scenes(own, WITHIN[way])
    if way == "thesis":
        return no_worse(t["error"])

    def limit(most: float) -> ex.Bound:
        return ex.at_most(most) if t["size"] == OWN else ex.number()

    found: dict[str, Any] = {
        "largest error of axis [deg]": (max(t["turns"]), limit(1.0)),
        "root mean square of position [mm]": t["rms"],
    }
    if way in UPRIGHT:
        return found | by_axis("largest error in {axis}", t["error"], [limit(0.3)] * 3)
    return found | {"largest error of position [mm]": (max(t["distances"]), limit(0.5))}


def of_scenes(own: ex.Trials, most: float) -> ex.Values:
    distances, certain = np.array(own["distance"], dtype=float), own["certain"]
    seen, near = np.isfinite(distances), np.mean(distances <= most)
    wrong = np.sum(certain & (distances > ANOTHER))
    return {
        f"share seen within {most:g} mm []": (near, ex.at_least(0.95)),
        "another thing is taken for it []": (wrong, ex.at_most(0.0)),
        "not seen []": np.sum(~seen),
        "seen, but not certain []": np.sum(seen & ~certain),
        "error of position, median [mm]": np.quantile(distances[seen], 0.5),
        "error of position, 95 % quantile [mm]": np.quantile(distances[seen], 0.95),
    }


localization = ex.Experiment(
    "Accuracy of the five-axis cell's camera in locating its standing, lying cylinder.",
    cases,
    trial,
    summary=summary,
    picture=[
        ex.Bars([f"largest error in {axis}" for axis in "xyz"], log=True),
        ex.Points("tilts", "distances", where={"way": TILTED}, limit=0.5),
        ex.Points("tilts", "distances", where={"way": LYING}, limit=0.5),
    ],
)

# Cameras that look straight down: where they hang in world [m]. The thesis describes
# its camera as above the middle of the scene, and publishes neither place nor angle. At
# 1.4 m, ours sees both tables from there.
OURS = "above both tables, as ours"
CAMERAS: dict[str, list[float] | None] = {
    OURS: None,
    "above the scene's middle, as the thesis's": [0.0, 0.0, 1.4],
    "above the cylinder": [*THESIS_PLACE[:2].tolist(), 1.0],
}
THESIS_RULE, OUR_RULE = "thesis's localizer", "our localizer"


def two_eyes(camera: str) -> dict[str, Eye]:
    """Return the thesis's localizer and ours, with a camera of `CAMERAS`."""
    own_camera = load_scenario(SCENARIO, seed=0).cameras[CAMERA]
    # As in CoppeliaSim, the optical axis passes through the middle of the image. By
    # default, Drake's passes half a pixel beside it, which the rule does not know.
    changes = [
        f"cameras.{CAMERA}.center_x={own_camera.width / 2}",
        f"cameras.{CAMERA}.center_y={own_camera.height / 2}",
    ]
    if (place := CAMERAS[camera]) is not None:
        changes.append(f"cameras.{CAMERA}.X_PB.translation={place}")
    scenario = load_scenario(SCENARIO, seed=0, overrides=changes)
    rule = dc.replace(scenario.localizer, thesis=ThesisBlobConfig())
    thesis = dc.replace(scenario, localizer=rule)
    return {THESIS_RULE: Eye(thesis), OUR_RULE: Eye(scenario)}


def thesis_cases() -> list[ex.Case]:
    return [*ex.grid(camera=CAMERAS, side=[0]), {"camera": OURS, "side": _SIDE}]


def thesis_trial(camera: str, side: int) -> ex.Measures:
    """Return the errors of both on the same images, (K, 3) each [mm]."""
    places = [RigidTransform(THESIS_PLACE)]
    if side:
        places = list(poses(load(OWN), STANDING))
    x, y, _ = np.array([X_WO.translation() for X_WO in places]).T
    where = "all over the region" if side else "at the thesis's place"
    found: ex.Measures = {"x [m]": x, "y [m]": y, "places": where}
    for rule, one in two_eyes(camera).items():
        found[rule] = 1e3 * np.array([one.offset(X_WO) for X_WO in places])
        found[f"{rule}: error in the plane [mm]"] = np.linalg.norm(
            found[rule][:, :2], axis=1
        )
    return found


def judge_rules(trials: ex.Trials) -> dict[str, ex.Values]:
    found: dict[str, ex.Values] = {}
    for t in trials.where(side=0):
        case = f"at the thesis's place, camera {t['camera']}"
        *plane, height = t[THESIS_RULE][0]
        # The rule gives a height 10 mm below the top, whatever the camera: 15 mm above
        # the centre. The thesis prints 14.989 mm; 0.1 mm is ten times what is missing.
        printed = ex.within(PRINTED[2], absolute=0.1, source="thesis")
        found[f"{case}, {THESIS_RULE}"] = {
            f"error in {axis}; the thesis prints {theirs:.3f} [mm]": error
            for axis, error, theirs in zip("xy", plane, PRINTED, strict=False)
        } | {"error in z; expected: as printed [mm]": (height, printed)}
        found[f"{case}, {OUR_RULE}"] = no_worse(abs(t[OUR_RULE][0]))
    region = next(t for t in trials if t["side"])
    for rule in (THESIS_RULE, OUR_RULE):
        largest = np.max(np.abs(region[rule]), axis=0)
        rows = by_axis("largest error in {axis}", largest, [ex.number()] * 3)
        found[f"all over the region, {rule}"] = rows
    thesis, own = (
        np.linalg.norm(region[rule], axis=1) for rule in (THESIS_RULE, OUR_RULE)
    )
    nearer = (np.sum(own < thesis), ex.at_least(len(own)))
    what = "places where our localizer is nearer to the centre []"
    return found | {"all over the region": {what: nearer}}


thesis_localizer = ex.Experiment(
    "The five-axis arm's thesis's localizer and ours, on the same images.",
    thesis_cases,
    thesis_trial,
    by=("camera", "side"),
    whole=judge_rules,
    picture=[
        ex.Points(
            *("x [m]", f"{rule}: error in the plane [mm]"),
            where={"camera": OURS},
            label=["places"],
        )
        for rule in (THESIS_RULE, OUR_RULE)
    ],
)
