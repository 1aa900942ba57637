"""Where the five-axis arm takes a cylinder that leans or lies, and stands it up.

The pads shall hold the cylinder along its axis, its middle at the tip: five conditions,
which leave five joints no choice of where the hand comes from. Onto a cylinder that
lies on a table it has to come straight from above. The planner is asked for a grid of
places and directions, without simulating; then the cell takes some of those that lie
within the claimed envelope. What leans would need a support; it is planned for alone,
as if it stood on its rim.
"""

from __future__ import annotations

import collections
import dataclasses as dc
import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.cell import MakeTaskPlanner
from drake_srg.cell.goals import goal_pose
from drake_srg.experiments.cycles import run_cycle
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.planning.motion.failure import PlanningFailure
from drake_srg.recording.figure import COLORS, make_figure, style_axes
from drake_srg.scenario import load_scenario
from drake_srg.types import Cylinder, Vector

SCENARIO = "assistive_arm"
UPRIGHT, LYING, SIMULATED = "upright", "lying", "lying, simulated"
LEANS = (15, 30, 45, 60)  # degrees
# What we claim of a cylinder that lies: its middle up to this far from joint 1's axis,
# its axis up to this angle off the line from there; and of one that leans, anywhere:
# by at most so much, up to this angle off straight away from the arm [m], [rad].
RADIUS, OFF_RADIAL = 0.28, np.deg2rad(15.0)
MOST_LEAN, LEANING_OFF = np.deg2rad((30.0, 30.0))
_CLAIMS = {
    UPRIGHT: "all planned",
    LYING: f"planned up to {1e3 * RADIUS:.0f} mm from joint 1 "
    f"and {np.rad2deg(OFF_RADIAL):.0f} degrees off radial",
}
_LEANING_CLAIM = (
    f"planned up to {np.rad2deg(LEANING_OFF):.0f} degrees off straight away"
)
_STANDING, _LYING, _LEANING = (5, 5), (9, 5), (3, 1)  # places along x and y
_STEP, _LEANING_STEP = 15, 30  # between directions [degrees]
_RUNS = 10
_NEAR = 0.245  # the region begins there, straight in front of the arm [m]
# In the planner's messages: figures, and which part of the hand or the arm it is.
_PARTICULARS = r"-?\d+\.\d+|\w+(?= and \w+ are)"
_CLEARANCE = 1.0  # of the recess, all around the cylinder [mm]


@dc.dataclass(frozen=True)
class Case:
    """A cylinder on table 1.

    Attributes:
        way: What it is a case of.
        radius: Of its middle from joint 1's axis [m].
        azimuth: Of its middle around that axis, 0 along -x of the world [rad].
        lean: Of its axis from the vertical [rad].
        off: Direction in which it leans, 0 straight away from the arm [rad].
    """

    way: str
    radius: float
    azimuth: float
    lean: float = 0.0
    off: float = 0.0

    @property
    def claimed(self) -> bool:
        """Whether it is within what we claim."""
        off = abs((self.off + np.pi) % (2.0 * np.pi) - np.pi)
        if self.way in (LYING, SIMULATED):
            off = min(off, np.pi - off)  # it has two ends
            return self.radius <= RADIUS and off <= OFF_RADIAL + 1e-9
        return self.lean <= MOST_LEAN + 1e-9 and off <= LEANING_OFF + 1e-9

    def __str__(self) -> str:
        return self.way


@dc.dataclass(frozen=True)
class Outcome:
    """What came of a case.

    Attributes:
        case: What was tried.
        failure: The planner's word; None for a plan, or a run that succeeded.
        message: Why there is no plan.
        error: Of the placement in x and y, where it was simulated [m].
    """

    case: Case
    failure: str | None
    message: str = ""
    error: float = np.nan


class Cell:
    """The scenario with its planner and its cylinder."""

    def __init__(self) -> None:
        scenario = load_scenario(SCENARIO)
        shape, region = scenario.objects[scenario.task.pick].shape, scenario.task.region
        assert isinstance(shape, Cylinder)
        assert region is not None
        self.shape, self.region, self.scenario = shape, region, scenario
        self._planner = MakeTaskPlanner(scenario)
        self._goal = goal_pose(scenario, shape)
        scene = self._planner.scene
        joint = scene.plant.GetJointByName(scene.joint_names[0])
        X_WJ = joint.frame_on_parent().CalcPoseInWorld(scene.context)
        self.center = np.array(X_WJ.translation()[:2])  # of joint 1's axis [m]

    def case(self, way: str, place: Vector, lean: float, off: float) -> Case:
        """Return the case of a middle at a place (2,) [m]."""
        x, y = self.center - place
        return Case(way, float(np.hypot(x, y)), float(np.arctan2(y, x)), lean, off)

    def place(self, case: Case) -> Vector:
        """Return where a case's middle is, (2,) [m]."""
        direction = np.array([np.cos(case.azimuth), np.sin(case.azimuth)])
        return self.center - case.radius * direction

    def turn(self, case: Case) -> Vector:
        """Return a case's roll, which lays z along -y, pitch and yaw, (3,) [rad]."""
        return np.array([case.lean, 0.0, case.azimuth + case.off - 0.5 * np.pi])

    def pose(self, case: Case) -> RigidTransform:
        """Return a case's X_WO [m], with its rim or its side on the table."""
        R_WO = RollPitchYaw(self.turn(case)).ToRotationMatrix()
        height = 0.5 * self.shape.length * np.cos(case.lean)
        height += self.scenario.table.height + self.shape.radius * np.sin(case.lean)
        return RigidTransform(R_WO, [*self.place(case), height])

    def plan(self, case: Case) -> Outcome:
        """Ask the planner for all motions, from home and back."""
        home, X_WO = self._planner.q_home, self.pose(case)
        result = self._planner.plan(home, X_WO, self.shape, self._goal)
        if isinstance(result, PlanningFailure):
            return Outcome(case, result.failure.value, result.message)
        return Outcome(case, None)

    def run(self, case: Case, seed: int) -> Outcome:
        """Simulate a cycle."""
        p = self.pose(case).translation().tolist()
        turn = np.rad2deg(self.turn(case)).tolist()
        pose = f"{{translation: {p}, rotation: !Rpy {{deg: {turn}}}}}"
        name = self.scenario.task.pick
        metrics = run_cycle(SCENARIO, seed, [f"objects.{name}.pose={pose}"]).metrics
        error = metrics.placement_error_m or [np.nan] * 3
        return Outcome(case, metrics.failure, "", float(np.max(np.abs(error[:2]))))


def make_cases(cell: Cell) -> list[Case]:
    """Return what is planned and what is run."""
    cases = [cell.case(UPRIGHT, p, 0.0, 0.0) for p in places(cell, *_STANDING)]
    for place in places(cell, *_LYING):
        for off in range(-90 + _STEP, 91, _STEP):
            cases.append(cell.case(LYING, place, 0.5 * np.pi, np.deg2rad(off)))
    for lean in LEANS:
        for place in places(cell, *_LEANING):
            for off in range(-180 + _LEANING_STEP, 181, _LEANING_STEP):
                tilt, turn = np.deg2rad((lean, off))
                cases.append(cell.case(f"leaning {lean} degrees", place, tilt, turn))
    rng, runs = np.random.default_rng(0), list[Case]()
    while len(runs) < _RUNS:
        place = rng.uniform(cell.region.min, cell.region.max)
        off = rng.uniform(-OFF_RADIAL, OFF_RADIAL) + np.pi * rng.integers(2)
        case = cell.case(SIMULATED, place, 0.5 * np.pi, off)
        runs += [case] if case.claimed else []
    return cases + runs


def places(cell: Cell, columns: int, rows: int) -> list[Vector]:
    """Return places all over the region where cylinders are put, its rim included."""
    (x_0, y_0), (x_1, y_1) = cell.region.min, cell.region.max
    ys = np.linspace(y_0, y_1, rows) if rows > 1 else [0.5 * (y_0 + y_1)]
    return [np.array([x, y]) for x in np.linspace(x_0, x_1, columns) for y in ys]


def edges(cell: Cell) -> tuple[float, float, float]:
    """Look how far a cylinder may lie, straight in front of the arm.

    Returns:
        From joint 1 with its own axis radial [m], and to the left and to the right off
        radial, in the middle of the claimed distances [rad].
    """

    def plans(radius: float, off: float) -> bool:
        case = Case(LYING, radius, 0.0, 0.5 * np.pi, off)
        return cell.plan(case).failure is None

    middle, right = 0.5 * (RADIUS + _NEAR), 0.5 * np.pi
    return (
        bisect(lambda radius: plans(radius, 0.0), middle, 2.0 * RADIUS, 0.0005),
        bisect(lambda off: plans(middle, off), 0.0, right, 0.005),
        bisect(lambda off: plans(middle, -off), 0.0, right, 0.005),
    )


def bisect(
    works: Callable[[float], bool], inside: float, outside: float, width: float
) -> float:
    """Return how far it works from `inside` on, within `width`; NaN for not at all."""
    if not works(inside):
        return np.nan
    while abs(outside - inside) > width:
        middle = 0.5 * (inside + outside)
        if works(middle):
            inside = middle
        else:
            outside = middle
    return inside


def run(track: Track) -> ExperimentResult:
    """Plan for all cases, simulate some, look for the edges."""
    cell, outcomes = Cell(), []
    for seed, case in enumerate(track(make_cases(cell))):
        simulated = case.way == SIMULATED
        outcomes.append(cell.run(case, seed) if simulated else cell.plan(case))
    return make_result(cell, outcomes, edges(cell))


def make_result(
    cell: Cell, outcomes: Sequence[Outcome], found: tuple[float, float, float]
) -> ExperimentResult:
    """Judge the outcomes, and count the planner's messages."""
    cases = [o.case for o in outcomes]
    xy = np.array([cell.place(case) for case in cases])
    columns: dict[str, Any] = {
        "way": [case.way for case in cases],
        "x [m]": xy[:, 0],
        "y [m]": xy[:, 1],
        "radius [m]": [case.radius for case in cases],
        "lean [deg]": [float(np.rad2deg(case.lean)) for case in cases],
        "off radial [deg]": [float(np.rad2deg(case.off)) for case in cases],
        "claimed": [int(case.claimed) for case in cases],
        "failure": [o.failure or "" for o in outcomes],
        "message": [o.message for o in outcomes],
        "placement error [m]": [o.error for o in outcomes],
    }
    why = collections.Counter(
        (o.case.way, o.failure, re.sub(_PARTICULARS, "#", o.message))
        for o in outcomes
        if o.failure
    ).most_common()
    reasons: dict[str, Any] = {
        "way": [way for (way, _, _), _ in why],
        "failure": [failure for (_, failure, _), _ in why],
        "message": [message for (_, _, message), _ in why],
        "count": [count for _, count in why],
    }
    return ExperimentResult(
        judge(outcomes, found),
        {"poses": columns, "reasons": reasons},
        draw(cell, outcomes),
    )


def share(outcomes: Sequence[Outcome]) -> float:
    """Return how many succeeded [%]."""
    return 100.0 * float(np.mean([o.failure is None for o in outcomes]))


def judge(outcomes: Sequence[Outcome], found: tuple[float, float, float]) -> list[Row]:
    """Judge what is claimed, and tell the rest; `found` as of `edges`."""
    ways = by_way(outcomes)
    rows = []
    for way, of_way in ways.items():
        if way == SIMULATED:
            continue
        claimed = [o for o in of_way if o.case.claimed]
        if claimed:
            what = _CLAIMS.get(way, _LEANING_CLAIM)
            rows.append(Row.at_least(way, what, 100.0, share(claimed), "%"))
        if way != UPRIGHT:
            what = "planned in all directions, of all places"
            rows.append(Row.info(way, what, share(of_way), "%"))
        failures = collections.Counter(o.failure for o in of_way if o.failure)
        for failure, count in sorted(failures.items()):
            rows.append(Row.info(way, f"not planned: {failure}", count, ""))
    (far, *offs), off = found, np.rad2deg(OFF_RADIAL)
    what = "furthest from joint 1, radial"
    rows.append(Row.at_least(LYING, what, 1e3 * RADIUS, 1e3 * far, "mm"))
    for side, value in zip(("left", "right"), np.rad2deg(offs), strict=True):
        what = f"furthest off radial, to the {side}"
        rows.append(Row.at_least(LYING, what, off, float(value), "deg"))
    runs = ways[SIMULATED]
    stood = sum(o.failure is None for o in runs)
    error = 1e3 * float(np.max([o.error for o in runs]))
    return [
        *rows,
        Row.at_least(SIMULATED, "stood up in the recess", len(runs), stood, ""),
        Row.at_most(SIMULATED, "largest error in x or y", _CLEARANCE, error, "mm"),
    ]


def by_way(outcomes: Sequence[Outcome]) -> dict[str, list[Outcome]]:
    """Return the outcomes by what they are cases of."""
    ways: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        ways.setdefault(outcome.case.way, []).append(outcome)
    return ways


def draw(cell: Cell, outcomes: Sequence[Outcome]) -> Any:
    """Draw a map of what lies, and how often what leans is planned, by direction."""
    figure = make_figure(11.0, 5.2, "Where the arm stands a cylinder up")
    table, shares = figure.subplots(1, 2, width_ratios=[1.1, 1.0])
    ways = by_way(outcomes)
    style_axes(table, xlabel="x [mm]", ylabel="y [mm]")
    for way, length, good in ((LYING, 7.0, COLORS[2]), (SIMULATED, 10.0, COLORS[0])):
        for o in ways.get(way, []):
            p, z = (
                1e3 * cell.place(o.case),
                cell.pose(o.case).rotation().matrix()[:2, 2],
            )
            ends = np.array([p - length * z, p + length * z])
            color, width = (good, 1.6) if o.failure is None else ("#c8ced6", 0.7)
            table.plot(*ends.T, "-", color=color, lw=width)
    angles = np.linspace(-0.5, 0.5, 50)
    arc = cell.center - RADIUS * np.column_stack([np.cos(angles), np.sin(angles)])
    table.plot(*1e3 * arc.T, "--", color=COLORS[-1], lw=0.8)
    side = 1e3 * np.array([cell.scenario.table.min, cell.scenario.table.max])
    table.set_xlim(*side[:, 0])
    table.set_ylim(*side[:, 1])
    table.set_aspect("equal")
    table.set_title(
        f"Lying: green planned, blue run; dashed {1e3 * RADIUS:.0f} mm from joint 1",
        fontsize=9, loc="left",
    )  # fmt: skip

    style_axes(shares, xlabel="direction off radial [deg]", ylabel="planned [%]")
    shown = [way for way in ways if way not in (UPRIGHT, SIMULATED)]
    for k, way in enumerate(shown):
        of_way = ways[way]
        offs = sorted({o.case.off for o in of_way})
        values = [share([o for o in of_way if o.case.off == off]) for off in offs]
        # Thinner and thinner, so that none hides another.
        shares.plot(np.rad2deg(offs), values, ".-", lw=3.0 - 0.5 * k, label=way)
    shares.set_title("Share of places, 0 away from the arm", fontsize=9, loc="left")
    shares.legend(fontsize=8, frameon=False)
    return figure
