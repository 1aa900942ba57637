"""Known objects, picked and placed by the planner of `kitchen`.

In `known_shapes`, boxes, balls and lying cans of known shape and colour lie anywhere in
the pick region, turned at random. The arm must set lying objects upright. In
`known_models`, objects may have any form. The planner knows their convex pieces and
colours, and must set them down as they were.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

import experiments.runner as ex
from experiments.stands.cells import metrics_of

YAW = "object.yaw=!Uniform {min: -3.1416, max: 3.1416}"


def _lying(shape: str, height: float) -> tuple[str, ...]:
    """Return the overrides of a shape that lies, its middle at a height [m]."""
    low, high = [0.45, -0.2, height], [0.75, 0.2, height]
    place = f"!UniformVector {{min: {low}, max: {high}}}"
    turn = "!Rpy {deg: !UniformVector {min: [90, 0, -180], max: [90, 0, 180]}}"
    pose = f"{{base_frame: world, translation: {place}, rotation: {turn}}}"
    return f"object.shape={shape}", f"object.pose={pose}"


def _box(least: Sequence[float], most: Sequence[float]) -> tuple[str, ...]:
    """Return the overrides of a box that stands, of a size between two (3,) [m]."""
    size = f"!UniformVector {{min: {list(least)}, max: {list(most)}}}"
    return f"object.shape=!Box {{size: {size}}}", YAW


def _model(model: str, lower: str, upper: str) -> tuple[str, ...]:
    """Return the overrides of a model, and its hue, saturation and value."""
    return (
        f"object.model=package://drake_srg/sdf/{model}.sdf",
        f"object.color_range={{lower: {lower}, upper: {upper}}}",
        YAW,
    )


# Overrides of the scenario. A ball rolls off a rigid table: nothing there resists that.
# So it is on the mat, with the facets that docs/speed.md asks for.
SHAPES = {
    "box": _box([0.03, 0.03, 0.05], [0.1, 0.1, 0.15]),
    "flat box": _box([0.04, 0.04, 0.02], [0.1, 0.1, 0.03]),
    "cracker box": _box([0.158, 0.066, 0.207], [0.158, 0.066, 0.207]),
    "lying can": _lying("!Cylinder {radius: 0.034, length: 0.102}", 0.034),
    "lying box": _lying("!Box {size: [0.05, 0.06, 0.12]}", 0.03),
    "ball": (
        "object.shape=!Sphere {radius: 0.035}",
        "object.resolution=0.0035",
        "plant_config.time_step=0.005",
        "arm.period=0.005",
        "directives.table.add_model.file=package://drake_srg/sdf/table_mat.sdf",
    ),
}
# Whatever its shape, the thing weighs about as much as the can.
_THING = ("object.model=null", "object.mass=0.3")
MODELS = {
    "mug": _model("mug", "[193, 0.39, 0.06]", "[217, 0.97, 1]"),
    "squeeze bottle": _model("squeeze_bottle", "[34, 0.54, 0.09]", "[58, 1, 1]"),
    "meat can": _model("010_potted_meat_can", "[209, 0.45, 0.06]", "[233, 1, 1]"),
    "hammer": _model("048_hammer", "[21, 0.28, 0.08]", "[45, 0.71, 1]"),
}
CASES = {**{name: (*_THING, *own) for name, own in SHAPES.items()}, **MODELS}


def shape_cases(
    trials: int = 40, seed: int = 940_000, cases: Sequence[str] = ()
) -> list[ex.Case]:
    seeds = range(seed, seed + trials)
    return ex.grid(case=ex.chosen("cases", cases, SHAPES), seed=seeds)


def model_cases(trials: int = 6, seed: int = 945_000) -> list[ex.Case]:
    return ex.grid(case=MODELS, seed=range(seed, seed + trials))


def trial(case: str, seed: int) -> ex.Measures:
    metrics = metrics_of("kitchen", seed, CASES[case])
    error, placed = metrics["placement_error_m"], bool(metrics["success"])
    off = 1e3 * np.linalg.norm(error[:2]) if placed and error is not None else None
    counts = {key: metrics[key] for key in ("failure", "attempts")}
    return {"placed": placed, "distance from the goal [mm]": off} | counts


def summary(own: ex.Trials) -> ex.Values:
    """Expect that most trials of every case succeed; report errors and failures."""
    placed, n = own["placed"], len(own)
    found: dict[str, Any] = {
        "trials []": (n, ex.number(spread=1.0)),
        "at the first attempt []": np.mean(placed & (own["attempts"] == 1)),
        **ex.share("placed", sum(placed), n, ex.at_least(0.95), spread=0.05),
    }
    apart, spread = own.known("distance from the goal [mm]"), ex.number(spread=0.5)
    if len(apart):
        found["distance from the goal, median [mm]"] = (np.median(apart), spread)
        found["distance from the goal, largest [mm]"] = (max(apart), spread)
    missed = own.where(placed=False)["failure"]
    return found | ex.counts(missed, "trials", least=2.0)


PICTURE: list[Any] = [ex.Bars(["placed"]), ex.Histogram("distance from the goal [mm]")]
known_shapes = ex.Experiment(
    "Known boxes, balls and lying cans, picked and placed by the planner of `kitchen`.",
    shape_cases,
    trial,
    summary=summary,
    picture=PICTURE,
)
known_models = ex.Experiment(
    "Known objects of any form, picked by the planner of `kitchen`, set down again.",
    model_cases,
    trial,
    summary=summary,
    picture=PICTURE,
)
