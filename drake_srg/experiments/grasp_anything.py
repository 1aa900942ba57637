"""Household objects in random poses, grasped from above by the depth image alone.

Each object is dropped in a random orientation. The planner does not know what it is: a
noisy depth image becomes a height map, the best grasp on it is tried, and the thing
counts as held if the hand alone holds it one second after it was lifted by 15 cm. After
a failure, the camera looks again at where the thing has come to rest.
"""

from __future__ import annotations

import dataclasses as dc
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drake_srg.common.exceptions import ScenarioError, suggest
from drake_srg.experiments.picking import REACH, SURFACE, Attempt, attempts
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import HOUSEHOLD, household_object
from drake_srg.planning.grasps.srg_hand import SrgFingers
from drake_srg.planning.grasps.top_grasps import HeightMapGrasps, TopGrasp
from drake_srg.recording.timeline import COLORS, make_figure
from drake_srg.sweeps.statistics import wilson_interval
from drake_srg.types import HeightMap
from drake_srg.vision.camera_errors import CameraErrorsConfig

# Share of household objects that an underactuated hand with RP joints grasps, at best.
PUBLISHED = 0.87
_SPAN, _STEP = 0.13, 0.006  # half the width of a drawn map, steps of its heights [m]
_MODELS = (".sdf", ".urdf", ".obj", ".stl", ".glb", ".gltf", ".xml", ".vtk")


@dc.dataclass(frozen=True, eq=False)
class Case:
    """A thing and the seed of its pose."""

    name: str
    thing: ObjectConfig
    seed: int

    def __str__(self) -> str:
        return f"{self.name}, seed {self.seed}"


def run(
    track: Track,
    *,
    objects: Sequence[str] = (),
    trials: int = 6,
    seed: int = 1000,
    attempts: int = 3,
    depth_noise: float = 1e-3,
) -> ExperimentResult:
    """Grasp every object in random poses.

    Args:
        track: Shows progress.
        objects: Names of household objects, or files of models; all household objects
            by default.
        trials: Poses of each object.
        seed: Seed of the first pose.
        attempts: Grasps to try before giving up.
        depth_noise: Standard deviation of depth at 1 m [m]; see `camera_errors`.
    """
    things = {Path(o).stem: _thing(o) for o in objects or HOUSEHOLD}
    planner = HeightMapGrasps(SrgFingers(), SURFACE.height, reach=REACH)
    noise = CameraErrorsConfig(depth_noise=depth_noise, depth_dropout=0.01)
    made: dict[Case, list[Attempt]] = {}
    # All objects in one pose before any in the next, so that the figure shows each.
    cases = [Case(n, t, seed + i) for i in range(trials) for n, t in things.items()]
    for case in track(cases):
        made[case] = _attempts(case, planner, attempts, noise)
    return ExperimentResult(judge(made), {"attempts": columns(made)}, draw(made))


def _attempts(
    case: Case, planner: HeightMapGrasps, most: int, noise: CameraErrorsConfig
) -> list[Attempt]:
    return attempts(
        case.name, case.thing, planner, seed=case.seed, most=most, noise=noise
    )


def _thing(name: str) -> ObjectConfig:
    """Return a household object, or the model of a file."""
    if name in HOUSEHOLD:
        return household_object(name)
    if Path(name).suffix in _MODELS:
        return ObjectConfig(model=name)
    raise ScenarioError(
        f"grasp_anything: objects: unknown object {name!r} {suggest(name, HOUSEHOLD)}"
    )


def judge(made: Mapping[Case, Sequence[Attempt]]) -> list[Row]:
    """Expect more than another underactuated hand holds, and state the rest."""
    trials = list(made.values())
    graspable = [t for t in trials if t[0].grasp is not None]
    rows = _share_rows("all", trials) + _share_rows(
        "with a grasp", graspable, PUBLISHED
    )
    failed = Counter(a.reason for t in trials for a in t if not a.held)
    for reason, count in sorted(failed.items()):
        spread = 3.0 + 0.3 * count  # contact is chaotic
        rows.append(Row.info("failed", reason, count, "attempts", spread=spread))
    tried = [a for t in trials for a in t if a.grasp is not None]
    wrong = sum(a.felt and not a.held for a in tried)
    spread = 3.0 + 0.3 * wrong
    rows.append(
        Row.info("fingers", "felt held, was not", wrong, "attempts", spread=spread)
    )
    wall = 1e3 * float(np.median([a.planning for t in trials for a in t]))
    rows.append(Row.info("planner", "a plan, median", wall, "ms", clock="time"))
    return rows


def _share_rows(
    name: str, trials: Sequence[Sequence[Attempt]], least: float | None = None
) -> list[Row]:
    """Return the shares of trials that held, of which `least` may be expected."""
    count = len(trials)
    rows = [Row.info(name, "trials", count, "", spread=1.0 + count / 8)]
    for what, last in (("first attempt", 0), ("any attempt", -1)):
        held = sum(trial[last].held for trial in trials)
        low, high = wilson_interval(held, count)
        share = held / max(count, 1)
        rows += [
            Row.info(name, f"held, {what}", share, "", spread=0.1)
            if least is None
            else Row.at_least(name, f"held, {what}", least, share, "", spread=0.1),
            Row.info(name, f"held, {what}, at least", low, "", spread=0.1),
            Row.info(name, f"held, {what}, at most", high, "", spread=0.1),
        ]
    return rows


def columns(made: Mapping[Case, Sequence[Attempt]]) -> dict[str, list[Any]]:
    """Return a line of the table for each attempt."""
    table: dict[str, list[Any]] = {}
    for case, trial in made.items():
        for number, attempt in enumerate(trial, 1):
            grasp = attempt.grasp
            for column, value in (
                ("object", case.name),
                ("seed", case.seed),
                ("attempt", number),
                ("held", int(attempt.held)),
                ("felt", int(attempt.felt)),
                ("reason", attempt.reason),
                ("candidates", len(attempt.plan.grasps)),
                ("width [mm]", 1e3 * grasp.width if grasp else np.nan),
                ("height [mm]", 1e3 * grasp.height if grasp else np.nan),
                ("score", grasp.score if grasp else np.nan),
            ):
                table.setdefault(column, []).append(value)
    return table


def draw(made: Mapping[Case, Sequence[Attempt]]) -> Any:
    """Draw the first height map of the first trial of each object, with its grasp."""
    shown: dict[str, Attempt] = {}
    held: Counter[str] = Counter()
    total = Counter(case.name for case in made)
    for case, trial in made.items():
        shown.setdefault(case.name, trial[0])
        held[case.name] += trial[0].held
    across = min(7, len(shown))
    down = -(-len(shown) // across)
    figure = make_figure(
        1.7 * across, 1.95 * down, "What the camera sees, the grasps, and how many held"
    )
    axes = figure.subplots(down, across, squeeze=False).ravel()
    for one in axes:
        one.set_axis_off()
    for one, (name, attempt) in zip(axes, shown.items(), strict=False):
        p_W = attempt.X_WO.translation()
        draw_map(one, attempt.map, attempt.plan.grasps[:6], (p_W[0], p_W[1]))
        ratio = f"{held[name]}/{total[name]}"
        one.set_title(f"{name.replace('_', ' ')}  {ratio}", fontsize=6.5, loc="left")
    return figure


def draw_map(
    axes: Any,
    map_: HeightMap,
    grasps: Sequence[TopGrasp] = (),
    middle: tuple[float, float] | None = None,
) -> None:
    """Draw a height map with grasps, the first one emphasized.

    Args:
        axes: Of matplotlib.
        map_: The map.
        grasps: The best first: a line between the open fingers, a bar for each pad.
        middle: x, y of what to show [m]; None for the whole map.
    """
    ny, nx = map_.height.shape
    x0, y0 = map_.origin - 0.5 * map_.resolution
    x1, y1 = map_.origin + (np.array([nx, ny]) - 0.5) * map_.resolution
    axes.set_axis_on()
    axes.set_facecolor("#cc6677")  # unknown
    # Steps hide the table's noise, which would make a large file.
    height = _STEP * np.round(map_.height / _STEP)
    axes.imshow(height, origin="lower", extent=(x0, x1, y0, y1), vmin=0.0, vmax=0.12)
    for number, grasp in reversed(list(enumerate(grasps))):
        style = {"color": "white", "lw": 0.5, "alpha": 0.6}
        if number == 0:
            style = {"color": COLORS[1], "lw": 2.0}
        along = np.array([np.cos(grasp.yaw), np.sin(grasp.yaw)])
        across = 0.5 * grasp.fingers.pad_width * np.array([-along[1], along[0]])
        ends = [grasp.p_WC[:2] + s * grasp.half_gap * along for s in (-1.0, 1.0)]
        axes.plot(*np.transpose(ends), **style)
        for end in ends:
            axes.plot(*np.transpose([end - across, end + across]), **style)
    if middle is not None:
        axes.set_xlim(middle[0] - _SPAN, middle[0] + _SPAN)
        axes.set_ylim(middle[1] - _SPAN, middle[1] + _SPAN)
    axes.set(xticks=[], yticks=[])
