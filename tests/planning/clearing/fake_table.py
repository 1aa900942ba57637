"""A table of things as a height map, and motions that take no planning."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.planning.clearing.choosing import PickPlanner
from drake_srg.planning.clearing.clearing_planner import ClearingPlanner
from drake_srg.planning.clearing.destination import Destination
from drake_srg.planning.clearing.knowledge import Pick
from drake_srg.planning.clearing.pushing import Push
from drake_srg.planning.grasps.segmentation import Segmentation
from drake_srg.planning.grasps.srg_hand import SrgFingers
from drake_srg.planning.grasps.top_grasps import GraspPlan, Refusal, TopGrasp, palm_pose
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.planning.planner_machine import PlannerConfig
from drake_srg.types import Failure, HeightMap, Mode

HOME, OVER, ASIDE = np.zeros(2), np.full(2, 4.0), np.full(2, 5.0)
OUT = np.full(2, 6.0)  # of a bin, straight up
BIN = Destination(np.array([0.1, 0.1]), np.array([0.4, 0.3]))  # on a map of its own
IN_BIN, BESIDE = (0.2, 0.2), (0.05, 0.2)  # on the map of the bin
HERE = Motion(HOME)
RESOLUTION = 0.005
A, B = (0.1, 0.1), (0.3, 0.2)  # places of things
SIDE = 0.04  # of the square things [m]
TALL = 0.05
HELD = np.array([0.8, 0.8, 0.3, 0.3, 0.0, 0.0, 0.0, 0.0])  # state with something
MODES = (Mode.PRE_GRASP, Mode.GRASP, Mode.LIFT, Mode.TRANSFER)
CONFIG = PlannerConfig(latency=0.1, search_time=0.0, gripper_timeout=0.5)


def table(*places, tall=TALL):
    """Return the map of a table with a square thing at each place."""
    height_map = HeightMap(np.zeros(2), RESOLUTION, np.zeros((80, 100)))
    middles = height_map.centers()
    for place in places:
        inside = np.all(np.abs(middles - place) < 0.5 * SIDE, axis=-1)
        height_map.height[inside] = tall
    return height_map


def moved(height_map):
    """Return a map of this table where the scenarios have theirs."""
    return dc.replace(height_map, origin=height_map.origin + np.array([0.4, -0.1]))


def crossing(inside, outside, height=0.15):
    """Return a bin with walls, and a bar over its front rim, so far on both sides."""
    deep = dc.replace(BIN, rim=0.12)
    shown = table()
    shown.height[deep.contains(shown)] = deep.rim
    shown.height[deep.contains(shown, -0.02)] = 0.02
    x, y = np.moveaxis(shown.centers(), -1, 0)
    bar = np.abs(y - deep.middle[1]) < 0.012
    bar &= (x > deep.low[0] - outside) & (x < deep.low[0] + inside)
    shown.height[bar] = height
    return deep, shown, bar


def grasp_at(place, width=SIDE, half_gap=0.05):
    """Return a grasp of the thing at a place."""
    p_WC = np.array([*place, 0.5 * TALL])
    return TopGrasp(
        X_WG=palm_pose(p_WC + np.array([0.0, 0.0, 0.17]), 0.0),
        fingers=SrgFingers(),
        half_gap=half_gap,
        width=width,
        p_WC=p_WC,
        height=TALL,
        score=1.0,
    )


class Grasps:
    """Stands in for a GraspPlanner: grasps whatever stands at known places."""

    def __init__(self, places, refused=(), width=SIDE):
        self.places = places
        self.width = width
        self.half_gap = 0.05  # of the open hand [m]
        self.refused = dict(refused)  # place: failure

    def plan(self, height_map, *, tried=(), seed=0):
        def stands(place):
            return height_map.height[tuple(height_map.cells(np.array(place)))] > 0.0

        left = [place for place in self.places if stands(place)]
        refused = [
            Refusal(np.array([*p, TALL]), (SIDE, SIDE), self.refused[p])
            for p in left
            if p in self.refused
        ]
        grasps = [
            grasp_at(p, self.width, self.half_gap)
            for p in left
            if p not in self.refused
        ]
        segments = Segmentation.of(height_map, 0.0, least_height=0.004, least_area=1e-4)
        return GraspPlan(
            tuple(grasps),
            len(left),
            lambda: tuple(refused),
            segments.places,
            segments.beside_same,
        )


class Motions:
    """Stands in for `ClearingMotions`: every motion takes a second."""

    q_home = HOME
    destination = BIN

    def __init__(self, unreachable=()):
        self.unreachable = unreachable
        self.taken = []
        self.starts = []
        self.places = False  # loads are set down, not dropped
        self.way_out = None  # end of the way up out of a bin

    def plan(self, q_start, grasp, height_map, number=0, *, filled=-np.inf, spots=None):
        place = tuple(np.round(grasp.p_WC[:2], 6))
        if place in self.unreachable:
            return PlanningFailure(Failure.OUT_OF_REACH, "too far")
        self.taken.append(place)
        self.starts.append(q_start)
        modes = (*MODES, Mode.PLACE) if self.places else MODES
        ends = [q_start, *(np.full(2, i + 1.0) for i in range(len(modes)))]
        lines = zip(modes, ends[:-1], ends[1:], strict=True)
        return {mode: _line(a, b) for mode, a, b in lines}

    def plan_way(self, q_start, q_goal):
        return _line(q_start, q_goal)

    def plan_retreat(self, q_start, fingers):
        return _line(q_start, OVER)

    def plan_up(self, q_start, fingers, palm):
        if self.way_out is None:
            return PlanningFailure(Failure.BLOCKED, "something is in its way")
        return _line(q_start, self.way_out)


class Pushes:
    """Stands in for `PushMotions`: two motions of a second each, over the bin."""

    def __init__(self):
        self.tried = []  # pushes before each one

    def plan(self, q_start, height_map, tried=()):
        self.tried.append(len(tried))
        if not height_map.height.any():
            return None
        motions = _line(q_start, np.full(2, 2.0)), _line(np.full(2, 2.0), OVER)
        return Push(np.zeros(3), np.ones(3), motions)


def _line(start, end):
    return PiecewisePolynomial.FirstOrderHold([0.0, 1.0], np.array([start, end]).T)


@dc.dataclass
class Run:
    """Advances a planner over a fake table, with an arm that follows at once."""

    grasps: Grasps
    motions: Motions
    shown: HeightMap
    config: PlannerConfig = dc.field(default_factory=lambda: CONFIG)
    pushes: Pushes | None = None
    picks: PickPlanner | None = None  # None: a new one

    def __post_init__(self):
        picks = self.picks or PickPlanner(
            self.grasps, self.motions, self.config, self.pushes, ASIDE
        )
        self.planner = ClearingPlanner(picks, 4, 4)
        self.simulator = Simulator(self.planner)
        self.context = self.simulator.get_mutable_context()
        self.modes = []
        self.show(self.shown)
        self.feel(False)
        self.follow()

    def fix(self, name, value):
        self.planner.GetInputPort(name).FixValue(self.context, value)

    def show(self, height_map):
        self.fix("height_map", height_map)

    def show_bin(self, *places, tall=TALL):
        """Show a bin with a thing at each place, on the map of destinations."""
        self.fix("destination_map", table(*places, tall=tall))

    def feel(self, held):
        self.fix("grasped", [float(held)])
        self.fix("gripper_state", HELD if held else np.zeros(8))
        self.fix("proximity", np.full(4, 0.0 if held else 0.01))

    def follow(self):
        port = self.planner.GetOutputPort("position_commanded")
        q = port.Eval(self.context)
        self.fix("arm_state", [*q, 0.0, 0.0])

    @property
    def status(self):
        return self.planner.GetOutputPort("status").Eval(self.context)

    def until(self, *modes, limit=30.0):
        """Advance until one of the modes begins, and return it."""
        end = self.context.get_time() + limit
        while self.context.get_time() < end:
            self.simulator.AdvanceTo(self.context.get_time() + 0.05)
            self.follow()
            mode = self.status.mode
            if not self.modes or self.modes[-1] is not mode:
                self.modes.append(mode)
                if mode in modes:
                    return mode
        raise AssertionError(f"still {self.status.mode}, not {modes}")


def pick(run, *, after, felt=True):
    """Let a pick happen; afterwards, the table looks like `after`."""
    run.until(Mode.CLOSE)
    run.feel(felt)
    run.until(Mode.TRANSFER)
    run.show(after)
    run.until(Mode.RELEASE)
    run.feel(False)


def run(*places, shown=None, config=CONFIG, unreachable=(), refused=(), width=SIDE):
    """Return a run over a table with things at some places."""
    motions = Motions(unreachable)
    seen = table(*places) if shown is None else shown
    return Run(Grasps(places, refused, width), motions, seen, config)


def over_bin(before, destination=None):
    """Return a pick of A that goes into a bin on the table's own map."""
    deep = destination or dc.replace(BIN, rim=0.12)
    return Pick(grasp_at(A), {}, before, deep, 0.0)
