"""Accuracy of the kitchen's camera in locating household objects, with their yaw.

Each object stands in random places or rests there on a random side. Only images are
simulated and judged. The localizer knows each object's collision geometry and one
colour of its model. In a few sightings that count as certain, the part that shows the
object's turn is hardly visible, such as a handle underneath.
"""

import colorsys
import dataclasses as dc
from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

import experiments.runner as ex
from drake_srg.objects.config import ColorRangeConfig, ObjectConfig
from drake_srg.objects.household import HOUSEHOLD, household_object
from drake_srg.objects.meshes.load import model_tree
from drake_srg.objects.solids import known_solid, object_pieces
from drake_srg.scenario import load_scenario
from drake_srg.vision.color import ColorRange
from drake_srg.vision.solids import turn_between
from experiments.stands.scenes import Eye

UPRIGHT, RESTING = "upright", "on any side"
POSES = {UPRIGHT: 6, RESTING: 4}  # of each object
# What a grasp needs, and the accuracy at which the can is located [mm, degrees].
MOST_OFF, MOST_TURN = 1.0, 1.0
# Less saturated colours count as grey, and less bright ones as black.
_GREY, _BLACK = 0.15, 0.2
# Places where all of an object is in the image [m].
_REGION = np.array([[0.45, -0.15], [0.7, 0.25]])


def cases(objects: Sequence[str] = ()) -> list[ex.Case]:
    """Locate household objects in many poses."""
    return ex.grid(object=objects or HOUSEHOLD, way=POSES)


def trial(object: str, way: str) -> ex.Measures:
    """Locate an object in random poses of a way; those of the other are drawn, too."""
    config = with_color(object, household_object(object))
    scenario = load_scenario("kitchen", seed=0)
    scenario.objects = {object: dc.replace(config, position=[0.6, 0.1])}
    scenario.task.pick = object
    pieces, p_OC = object_pieces(object, config)
    known = known_solid(object, config)
    assert known is not None
    solid, _ = known
    eye, rng = Eye(scenario), np.random.default_rng(0)
    off, turn, certain = [], [], []
    for drawn in (way for way, count in POSES.items() for _ in range(count)):
        down = np.array([0.0, 0.0, -1.0])
        if drawn == RESTING:
            down = pieces.resting[rng.integers(len(pieces.resting))]
        R_WO = RotationMatrix.MakeFromOneVector(-down, 2).inverse()
        R_WO = RotationMatrix.MakeZRotation(rng.uniform(-np.pi, np.pi)) @ R_WO
        lowest = ((pieces.corners + p_OC) @ R_WO.matrix().T)[:, 2].min()
        place = rng.uniform(*_REGION)
        X_WO = RigidTransform(R_WO, [*place, scenario.table.height - lowest])
        if drawn != way:
            continue
        blob = next(iter(eye.blobs(X_WO)), None)
        certain.append(blob is not None and blob.certain)
        if blob is None:
            off.append(np.nan)
            turn.append(np.nan)
            continue
        off.append(1e3 * float(np.linalg.norm(blob.X_WO @ p_OC - X_WO @ p_OC)))
        turn.append(np.rad2deg(turn_between(solid, blob.X_WO.rotation(), R_WO)))
    return {"off": off, "turn": turn, "certain": certain}


def with_color(name: str, config: ObjectConfig) -> ObjectConfig:
    """Return an object whose target colour is that of its model's first part.

    If that is grey, like the table, another part's colour tells more.
    """
    diffuse = [
        [float(x) for x in (element.text or "").split()]
        for element in model_tree(name, config).iter("diffuse")
    ]

    def saturation(rgba: list[float]) -> float:
        return colorsys.rgb_to_hsv(*rgba[:3])[1]

    grey = saturation(diffuse[0]) < _GREY
    color = max(diffuse, key=saturation) if grey else diffuse[0]
    colors = ColorRange.around(color)
    lower, upper = list(colors.lower), list(colors.upper)
    if max(color[:3]) < _BLACK:  # whose hue and saturation are noise
        lower, upper = [0.0, 0.0, 0.0], [360.0, 1.0, _BLACK]
    return dc.replace(config, color_range=ColorRangeConfig(lower=lower, upper=upper))


def summary(own: ex.Trials) -> ex.Values:
    certain, off, turn = (np.concatenate(own[k]) for k in ("certain", "off", "turn"))
    found: dict[str, Any] = {"share located with certainty []": np.mean(certain)}
    for what, unit, values in (
        ("error of the centre", "mm", off[certain]),
        ("error of the orientation", "deg", turn[certain]),
    ):
        known = values if len(values) else [np.nan]
        found[f"median {what} [{unit}]"] = np.median(known)
        found[f"largest {what} [{unit}]"] = np.max(known)
    return found


def whole(trials: ex.Trials) -> dict[str, ex.Values]:
    certain, off, turn = (
        np.concatenate([t[key] for t in trials]) for key in ("certain", "off", "turn")
    )
    good = certain & (off <= MOST_OFF) & (turn <= MOST_TURN)
    share = np.sum(good) / max(1, np.sum(certain))
    return {
        "all": {
            "share located with certainty []": np.mean(certain),
            "share of these within 1 mm and 1 degree []": share,
        }
    }


object_localization = ex.Experiment(
    "Accuracy of the kitchen's camera in locating household objects, with their yaw.",
    cases,
    trial,
    {
        "median error of the centre": ex.at_most(MOST_OFF),
        "median error of the orientation": ex.at_most(MOST_TURN),
        "share of these within 1 mm and 1 degree": ex.at_least(0.95),
    },
    by=("object", "way"),
    summary=summary,
    whole=whole,
    picture=[ex.Points("off", "turn", label=["way"], limit=MOST_TURN, log="xy")],
)
