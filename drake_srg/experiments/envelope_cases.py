"""Cylinders that stand, lie or lean on the table of the five-axis arm's cell."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.experiments.cycles import run_cycle
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeTaskPlanner
from drake_srg.station.planners import goal_pose
from drake_srg.types import Cylinder, Vector

SCENARIO = "assistive_arm"
UPRIGHT, LYING, SIMULATED = "upright", "lying", "lying, simulated"
LEANS = (15, 30, 45, 60)  # degrees
# Our claims. Lying: its middle up to this distance from joint 1's axis [m], its axis up
# to this angle off the radial direction [rad]. Leaning, anywhere: up to this lean, and
# up to this angle off the direction away from the arm [rad].
RADIUS, OFF_RADIAL = 0.28, np.deg2rad(15.0)
MOST_LEAN, LEANING_OFF = np.deg2rad((30.0, 30.0))
_STANDING, _LYING, _LEANING = (5, 5), (9, 5), (3, 1)  # places along x and y
_STEP, _LEANING_STEP = 15, 30  # between directions [degrees]
_NEAR = 0.245  # where the region begins, straight in front of the arm [m]


@dc.dataclass(frozen=True)
class Case:
    """A cylinder on table 1.

    Attributes:
        way: How the cylinder stands or lies, and whether it is simulated.
        radius: Distance of its middle from joint 1's axis [m].
        azimuth: Of its middle around that axis, 0 along the world's -x [rad].
        lean: Angle of its axis from the vertical [rad].
        off: Direction of the lean, 0 straight away from the arm [rad].
    """

    way: str
    radius: float
    azimuth: float
    lean: float = 0.0
    off: float = 0.0

    @property
    def claimed(self) -> bool:
        """Whether the case is within the claimed envelope."""
        off = abs((self.off + np.pi) % (2.0 * np.pi) - np.pi)
        if self.way in (LYING, SIMULATED):
            off = min(off, np.pi - off)  # a lying cylinder has two ends
            return self.radius <= RADIUS and off <= OFF_RADIAL + 1e-9
        return self.lean <= MOST_LEAN + 1e-9 and off <= LEANING_OFF + 1e-9

    def __str__(self) -> str:
        return self.way


@dc.dataclass(frozen=True)
class Outcome:
    """The outcome of a case.

    Attributes:
        case: The case.
        failure: The planner's word; None for a plan or a successful run.
        message: Why there is no plan.
        error: Larger of the placement errors in x and y, if simulated [m].
    """

    case: Case
    failure: str | None
    message: str = ""
    error: float = np.nan


class Cell:
    """The scenario with its planner and its cylinder.

    Attributes:
        shape: The cylinder.
        region: Where cylinders are put.
        scenario: The scenario.
        center: Position of joint 1's axis, shape (2,) [m].
    """

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
        self.center = np.array(X_WJ.translation()[:2])

    def case(self, way: str, place: Vector, lean: float, off: float) -> Case:
        """Return the case of a cylinder with its middle at a place (2,) [m]."""
        x, y = self.center - place
        return Case(way, float(np.hypot(x, y)), float(np.arctan2(y, x)), lean, off)

    def place(self, case: Case) -> Vector:
        """Return the position of the cylinder's middle, shape (2,) [m]."""
        direction = np.array([np.cos(case.azimuth), np.sin(case.azimuth)])
        return self.center - case.radius * direction

    def turn(self, case: Case) -> Vector:
        """Return roll (which turns z towards -y), pitch and yaw, shape (3,) [rad]."""
        return np.array([case.lean, 0.0, case.azimuth + case.off - 0.5 * np.pi])

    def pose(self, case: Case) -> RigidTransform:
        """Return the cylinder's X_WO, with its rim or side on the table."""
        R_WO = RollPitchYaw(self.turn(case)).ToRotationMatrix()
        height = 0.5 * self.shape.length * np.cos(case.lean)
        height += self.scenario.table.height + self.shape.radius * np.sin(case.lean)
        return RigidTransform(R_WO, [*self.place(case), height])

    def plan(self, case: Case) -> Outcome:
        """Plan all motions, from home and back."""
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


def make_cases(cell: Cell, runs: int) -> list[Case]:
    """Return the cases to plan and, after them, as many random cases to simulate."""
    cases = [cell.case(UPRIGHT, p, 0.0, 0.0) for p in places(cell, *_STANDING)]
    for place in places(cell, *_LYING):
        for off in range(-90 + _STEP, 91, _STEP):
            cases.append(cell.case(LYING, place, 0.5 * np.pi, np.deg2rad(off)))
    for lean in LEANS:
        for place in places(cell, *_LEANING):
            for off in range(-180 + _LEANING_STEP, 181, _LEANING_STEP):
                tilt, turn = np.deg2rad((lean, off))
                cases.append(cell.case(f"leaning {lean} degrees", place, tilt, turn))
    rng, simulated = np.random.default_rng(0), list[Case]()
    while len(simulated) < runs:
        place = rng.uniform(cell.region.min, cell.region.max)
        off = rng.uniform(-OFF_RADIAL, OFF_RADIAL) + np.pi * rng.integers(2)
        case = cell.case(SIMULATED, place, 0.5 * np.pi, off)
        simulated += [case] if case.claimed else []
    return cases + simulated


def places(cell: Cell, columns: int, rows: int) -> list[Vector]:
    """Return a grid of places (2,) over the region, including its rim [m]."""
    (x_0, y_0), (x_1, y_1) = cell.region.min, cell.region.max
    ys = np.linspace(y_0, y_1, rows) if rows > 1 else [0.5 * (y_0 + y_1)]
    return [np.array([x, y]) for x in np.linspace(x_0, x_1, columns) for y in ys]


def edges(cell: Cell) -> tuple[float, float, float]:
    """Find the edges of the envelope for lying cylinders in front of the arm.

    Returns:
        Largest distance from joint 1 with a radial axis [m]; largest angles off radial
        to the left and to the right, in the middle of the claimed distances [rad].
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
    """Return the last value that works between `inside` and `outside`.

    The result is accurate to `width`, and NaN if `inside` does not work.
    """
    if not works(inside):
        return np.nan
    while abs(outside - inside) > width:
        middle = 0.5 * (inside + outside)
        if works(middle):
            inside = middle
        else:
            outside = middle
    return inside
