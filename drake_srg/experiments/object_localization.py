"""How accurately the kitchen's camera locates household objects, with their yaw.

Each object stands in random places or rests there on a random side. Nothing is
simulated: only the images are judged. The localizer knows each object's collision
geometry and one colour of its model.
"""

from __future__ import annotations

import colorsys
import dataclasses as dc
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.experiments.localization_cases import Eye
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.objects.config import ColorRangeConfig, ObjectConfig
from drake_srg.objects.household import HOUSEHOLD, household_object
from drake_srg.objects.meshes.load import model_tree
from drake_srg.objects.solids import known_solid, object_pieces
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.scenario import load_scenario
from drake_srg.types import Vector
from drake_srg.vision.color import ColorRange
from drake_srg.vision.solids import turn_between

SCENARIO = "kitchen"
UPRIGHT, RESTING = "upright", "on any side"
# What a grasp needs, and the accuracy at which the can is located [m, rad].
MOST_OFF, MOST_TURN = 1e-3, np.deg2rad(1.0)
# Of the sightings that count as certain, the share that must be so accurate: a few show
# too little of what makes an object's turn visible, such as a handle underneath it.
_LEAST_GOOD = 0.95
# Less saturated colours count as grey, and less bright ones as black.
_GREY, _BLACK = 0.15, 0.2
# Places where all of an object is in the image [m].
_REGION = np.array([[0.45, -0.15], [0.7, 0.25]])


@dc.dataclass(frozen=True)
class Found:
    """How an object was located; NaN if it was not.

    Attributes:
        off: Distance of the estimated from the true centre [m].
        turn: Angle between the orientations, as far as the shape shows it [rad].
        certain: Whether the localizer was certain.
    """

    off: float
    turn: float
    certain: bool


_Findings = Mapping[str, Mapping[str, Sequence[Found]]]


def run(
    track: Track, *, upright: int = 6, resting: int = 4, objects: Sequence[str] = ()
) -> ExperimentResult:
    """Locate household objects in many poses.

    Args:
        track: Shows progress.
        upright: Poses in which each object stands.
        resting: Poses in which it rests on a random side.
        objects: Names of the objects; all by default.
    """
    findings = {}
    for name in track(list(objects or HOUSEHOLD)):
        findings[name] = look(name, upright, resting)
    return make_result(findings)


def look(name: str, upright: int, resting: int) -> dict[str, list[Found]]:
    """Locate an object in random poses, by way of resting."""
    config = with_color(name, household_object(name))
    scenario = load_scenario(SCENARIO, seed=0)
    scenario.objects = {name: dc.replace(config, position=[0.6, 0.1])}
    scenario.task.pick = name
    pieces, p_OC = object_pieces(name, config)
    known = known_solid(name, config)
    assert known is not None
    solid, _ = known
    eye, rng = Eye(scenario), np.random.default_rng(0)
    found: dict[str, list[Found]] = {UPRIGHT: [], RESTING: []}
    for way in (UPRIGHT,) * upright + (RESTING,) * resting:
        down = np.array([0.0, 0.0, -1.0])
        if way == RESTING:
            down = pieces.resting[rng.integers(len(pieces.resting))]
        R_WO = RotationMatrix.MakeFromOneVector(-down, 2).inverse()
        R_WO = RotationMatrix.MakeZRotation(rng.uniform(-np.pi, np.pi)) @ R_WO
        lowest = ((pieces.corners + p_OC) @ R_WO.matrix().T)[:, 2].min()
        place = rng.uniform(*_REGION)
        X_WO = RigidTransform(R_WO, [*place, scenario.table.height - lowest])
        blobs = eye.blobs(X_WO)
        if not blobs:
            found[way].append(Found(np.nan, np.nan, False))
            continue
        blob = blobs[0]
        off = float(np.linalg.norm(blob.X_WO @ p_OC - X_WO @ p_OC))
        turn = turn_between(solid, blob.X_WO.rotation(), R_WO)
        found[way].append(Found(off, turn, blob.certain))
    return found


def with_color(name: str, config: ObjectConfig) -> ObjectConfig:
    """Return an object that is looked for by the colour of its model's first part.

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


def make_result(findings: _Findings) -> ExperimentResult:
    """Judge how objects were located.

    Args:
        findings: By the object's name and its way of resting.
    """
    rows = [
        row
        for name, ways in findings.items()
        for way, found in ways.items()
        if found
        for row in judge(f"{name}, {way}", found)
    ]
    flat = [
        (name, way, f)
        for name, ways in findings.items()
        for way, found in ways.items()
        for f in found
    ]
    sure = [f for _, _, f in flat if f.certain]
    good = sum(f.off <= MOST_OFF and f.turn <= MOST_TURN for f in sure)
    rows += [
        Row.info("all", "share located with certainty", len(sure) / len(flat), ""),
        Row.at_least(
            "all",
            "share of these within 1 mm and 1 degree",
            _LEAST_GOOD,
            good / max(1, len(sure)),
            "",
        ),
    ]
    table: dict[str, Any] = {
        "object": [name for name, _, _ in flat],
        "way": [way for _, way, _ in flat],
        "error of the centre [m]": [found.off for _, _, found in flat],
        "error of the orientation [rad]": [found.turn for _, _, found in flat],
        "certain": [int(found.certain) for _, _, found in flat],
    }
    return ExperimentResult(rows, {"sightings": table}, draw(findings))


def judge(name: str, found: Sequence[Found]) -> list[Row]:
    """Judge the sightings of one object in one way that were certain."""
    sure = [f for f in found if f.certain]
    off = 1e3 * np.array([f.off for f in sure] or [np.nan])
    turn = np.rad2deg([f.turn for f in sure] or [np.nan])
    most_off, most_turn = 1e3 * MOST_OFF, float(np.rad2deg(MOST_TURN))
    place, angle = "error of the centre", "error of the orientation"
    return [
        Row.info(name, "share located with certainty", len(sure) / len(found), ""),
        Row.at_most(name, f"median {place}", most_off, float(np.median(off)), "mm"),
        Row.at_most(name, f"median {angle}", most_turn, float(np.median(turn)), "deg"),
        Row.info(name, f"largest {place}", float(off.max()), "mm"),
        Row.info(name, f"largest {angle}", float(turn.max()), "deg"),
    ]


def draw(findings: _Findings) -> Any:
    """Draw the errors of each object."""
    figure = make_figure(10.0, 6.5, "Where the kitchen's camera sees household objects")
    axes = figure.subplots(1, 2, sharey=True)
    names = list(findings)
    for panel, attribute, scale, limit, label in (
        (axes[0], "off", 1e3, 1e3 * MOST_OFF, "error of the centre [mm]"),
        (axes[1], "turn", np.rad2deg(1.0), 1.0, "error of the orientation [deg]"),
    ):
        style_axes(panel, xlabel=label)
        for k, way in enumerate((UPRIGHT, RESTING)):
            for certain, marker in ((True, "o"), (False, "x")):
                points = [
                    (scale * getattr(found, attribute), row)
                    for row, name in enumerate(names)
                    for found in findings[name][way]
                    if found.certain == certain
                ]
                style = {"color": COLORS[k], "ms": 4, "label": way if certain else None}
                values: Vector = np.array(points).reshape(-1, 2)
                panel.plot(*values.T, marker, ls="", **style)
        panel.axvline(limit, color=COLORS[-1], lw=0.8, ls="--")
        panel.set_xscale("log")
    axes[0].set_yticks(range(len(names)), names, fontsize=7)
    axes[0].invert_yaxis()
    axes[0].legend(fontsize=8, frameon=False)
    axes[0].set_title("Cross: uncertain; dashed: limit", fontsize=9, loc="left")
    return figure
