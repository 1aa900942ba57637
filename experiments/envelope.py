"""The places where the five-axis arm can stand a leaning or lying cylinder upright.

The pads must hold the cylinder along its axis, with its middle at the tip. These are
five conditions, so five joints leave no choice of the approach. The hand must come
straight from above onto a cylinder that lies on the table.

The planner plans for a grid of places and directions without simulation. Then the cell
simulates some cases within the claimed envelope. A leaning cylinder would need a
support. It is only planned, as if it stood on its rim.
"""

import functools
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

import experiments.runner as ex
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeTaskPlanner
from drake_srg.station.planners import goal_pose
from drake_srg.types import Cylinder, Vector
from experiments.stands.cycles import run_cycle

SCENARIO = "assistive_arm"
UPRIGHT, LYING, SIMULATED = "upright", "lying", "lying, simulated"
# Our claims. Lying: its middle up to this distance from joint 1's axis [m], its axis up
# to this angle off the radial direction [degrees]. Leaning, anywhere: up to this lean,
# and up to this angle off the direction away from the arm [degrees].
RADIUS, OFF_RADIAL, MOST_LEAN, LEANING_OFF = 0.28, 15.0, 30.0, 30.0
# By way: lean [degrees], places along x and y, step between directions, from where to
# its opposite [degrees].
GRIDS = {
    LYING: (90.0, (9, 5), 15, -90),
    **{
        f"leaning {lean} degrees": (float(lean), (3, 1), 30, -180)
        for lean in (15, 30, 45, 60)
    },
}
RADIAL, OFF = "distance from joint 1 [mm]", "angle off radial [degrees]"
_RUNS = 10  # simulated cycles
_NEAR = 0.245  # where the region begins, straight in front of the arm [m]


class Cell:
    """The scenario with its planner and its cylinder.

    A case is the place of the cylinder's middle, shape (2,) [m], the angle of its axis
    from the vertical, `lean`, and the direction of the lean, `off`, 0 straight away
    from the arm [degrees].
    """

    def __init__(self) -> None:
        scenario = load_scenario(SCENARIO)
        shape, region = scenario.objects[scenario.task.pick].shape, scenario.task.region
        assert isinstance(shape, Cylinder)
        assert region is not None
        self.region, self.name = region, scenario.task.pick
        self._shape, self._table = shape, scenario.table
        self._planner = MakeTaskPlanner(scenario)
        self._goal = goal_pose(scenario, shape)
        scene = self._planner.scene
        joint = scene.plant.GetJointByName(scene.joint_names[0])
        X_WJ = joint.frame_on_parent().CalcPoseInWorld(scene.context)
        self.center = np.array(X_WJ.translation()[:2])

    def pose(self, place: Vector, lean: float, off: float) -> RigidTransform:
        """Return the cylinder's X_WO, with its rim or side on the table."""
        tilt = np.deg2rad(lean)
        height = 0.5 * self._shape.length * np.cos(tilt)
        height += self._table.height + self._shape.radius * np.sin(tilt)
        return RigidTransform(
            RollPitchYaw(self.turn(place, lean, off)), [*place, height]
        )

    def turn(self, place: Vector, lean: float, off: float) -> Vector:
        """Return roll (which turns z towards -y), pitch and yaw, shape (3,) [rad]."""
        x, y = self.center - place
        yaw = np.arctan2(y, x) + np.deg2rad(off) - 0.5 * np.pi
        return np.array([np.deg2rad(lean), 0.0, yaw])

    def plan(self, place: Vector, lean: float, off: float) -> str | None:
        """Plan all motions, from home and back; return the failure, if any."""
        home, X_WO = self._planner.q_home, self.pose(place, lean, off)
        result = self._planner.plan(home, X_WO, self._shape, self._goal)
        failed = isinstance(result, PlanningFailure)
        return str(result.failure.value) if failed else None

    def places(self, columns: int, rows: int) -> list[Vector]:
        """Return a grid of places (2,) over the region, including its rim [m]."""
        (x_0, y_0), (x_1, y_1) = self.region.min, self.region.max
        ys = np.linspace(y_0, y_1, rows) if rows > 1 else [0.5 * (y_0 + y_1)]
        return [np.array([x, y]) for x in np.linspace(x_0, x_1, columns) for y in ys]

    def claimed(self, place: Vector, lean: float, off: float) -> bool:
        """Return whether a case is within the claimed envelope."""
        off = abs((off + 180.0) % 360.0 - 180.0)
        if lean == 90.0:
            off = min(off, 180.0 - off)  # a lying cylinder has two ends
            radius = float(np.linalg.norm(self.center - place))
            return radius <= RADIUS and off <= OFF_RADIAL + 1e-6
        return lean <= MOST_LEAN + 1e-6 and off <= LEANING_OFF + 1e-6


cell = functools.cache(Cell)


def cases() -> list[ex.Case]:
    """Plan for every case, simulate some, and find the edges of the envelope."""
    here = cell()
    found = [(UPRIGHT, p, 0.0, 0.0) for p in here.places(5, 5)]
    for way, (lean, grid, step, start) in GRIDS.items():
        for place in here.places(*grid):
            directions = map(float, range(start + step, 1 - start, step))
            found += [(way, place, lean, off) for off in directions]
    planned, rng = len(found), np.random.default_rng(0)
    while len(found) < planned + _RUNS:
        place = rng.uniform(here.region.min, here.region.max)
        bound = np.deg2rad(OFF_RADIAL)
        off = float(np.rad2deg(rng.uniform(-bound, bound) + np.pi * rng.integers(2)))
        if here.claimed(place, 90.0, off):
            found.append((SIMULATED, place, 90.0, off))
    edge = {"way": "edges", "place": None, "lean": 90.0, "off": 0.0, "seed": None}
    return [
        {"way": way, "place": place.tolist(), "lean": lean, "off": off}
        | {"seed": i if way == SIMULATED else None}
        for i, (way, place, lean, off) in enumerate(found)
    ] + [edge]


def trial(
    way: str, place: list[float] | None, lean: float, off: float, seed: int | None
) -> ex.Measures:
    here = cell()
    if place is None:
        return {"edges": edges(here)}
    at = np.array(place)
    radius = 1e3 * np.linalg.norm(here.center - at)
    shown = {RADIAL: radius, OFF: (off + 90.0) % 180.0 - 90.0}  # two ends look alike
    if seed is None:
        claimed = here.claimed(at, lean, off)
        return {"claimed": claimed, "failure": here.plan(at, lean, off)} | shown
    p = here.pose(at, lean, off).translation().tolist()
    turn = np.rad2deg(here.turn(at, lean, off)).tolist()
    pose = f"{{translation: {p}, rotation: !Rpy {{deg: {turn}}}}}"
    cycle = run_cycle(SCENARIO, seed, [f"objects.{here.name}.pose={pose}"])
    error = cycle["placement"]
    off_goal = np.nan if error is None else 1e3 * max(np.abs(error[:2]))
    return {"failure": cycle["failure"], "error": off_goal} | shown


def edges(here: Cell) -> list[float]:
    """Find the edges of the envelope for lying cylinders in front of the arm.

    These are the largest distance from joint 1 with a radial axis [mm]; and the largest
    angles off radial to both sides, in the middle of the claimed distances [degrees].
    """

    def plans(radius: float, off: float) -> bool:
        place = here.center - [radius, 0.0]
        return here.plan(place, 90.0, np.rad2deg(off)) is None

    middle, right = 0.5 * (RADIUS + _NEAR), 0.5 * np.pi
    far = bisect(lambda radius: plans(radius, 0.0), middle, 2.0 * RADIUS, 0.0005)
    left = bisect(lambda off: plans(middle, off), 0.0, right, 0.005)
    other = bisect(lambda off: plans(middle, -off), 0.0, right, 0.005)
    return [1e3 * far, np.rad2deg(left), np.rad2deg(other)]


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


def summary(own: ex.Trials) -> ex.Values:
    way = own.name
    if way == "edges":
        return {}
    planned = np.array([t["failure"] is None for t in own])
    if way == SIMULATED:
        return {
            "stood up in the recess []": (sum(planned), ex.at_least(len(own))),
            "largest error in x or y [mm]": max(own["error"]),
        }
    claim = f"planned up to {LEANING_OFF:.0f} degrees off the arm's direction"
    if way == LYING:
        claim = f"planned up to {1e3 * RADIUS:.0f} mm from joint 1 "
        claim += f"and {OFF_RADIAL:.0f} degrees off radial"
    found: dict[str, Any] = {}
    if any(claimed := own["claimed"]):
        what = "planned" if way == UPRIGHT else claim
        found[f"{what} [%]"] = (100.0 * np.mean(planned[claimed]), ex.at_least(100.0))
    if way != UPRIGHT:
        found["planned, all places and directions [%]"] = 100.0 * np.mean(planned)
    for failure, n in Counter(t["failure"] for t in own if t["failure"]).items():
        found[f"not planned: {failure} []"] = n
    if way == LYING:
        (edge,) = own.whole.where(way="edges")
        far, left, right = edge["edges"]
        found["largest distance from joint 1, radial [mm]"] = far
        found["largest angle off radial, to the left [deg]"] = left
        found["largest angle off radial, to the right [deg]"] = right
    return found


envelope = ex.Experiment(
    "Places where the five-axis arm can stand a leaning or lying cylinder upright.",
    cases,
    trial,
    {
        "largest error in x or y": ex.at_most(1.0),  # the recess's clearance
        "largest distance from joint 1, radial": ex.at_least(1e3 * RADIUS),
        "largest angle off radial, to the left": ex.at_least(OFF_RADIAL),
        "largest angle off radial, to the right": ex.at_least(OFF_RADIAL),
    },
    summary=summary,
    picture=[
        ex.Points(RADIAL, OFF, where={"way": way}, label=["failure"], title=way)
        for way in (LYING, SIMULATED)
    ],
)
