"""Two arms that clear one table: claims, views, walls, and turns."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.planning.clearing.sharing import (
    NO_CLAIM,
    Claim,
    JointStatus,
    SharingMemory,
    SharingPickPlanner,
    SharingPlanner,
    joint_status,
)
from drake_srg.planning.clearing.walls import (
    BEYOND,
    GAP,
    HALF,
    SIDE,
    Frontier,
    SharedHeightMap,
    Wall,
    WalledMotions,
)
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.planning.planner_machine import PlannerConfig
from drake_srg.scenario import load_scenario
from drake_srg.station.clearing import MakeClearingPair
from drake_srg.types import Failure, HeightMap, Mode, PlannerStatus, Remaining
from planning.clearing.fake_table import (
    ASIDE,
    HELD,
    HERE,
    TALL,
    Grasps,
    Motions,
    grasp_at,
    table,
)

CONFIG = PlannerConfig(latency=0.0, search_time=0.0, gripper_timeout=0.5)
STEP = 0.05
HOLDS = (Mode.PRE_GRASP, Mode.GRASP, Mode.CLOSE, Mode.LIFT, Mode.TRANSFER)
DEPTHS = st.sampled_from([SIDE, HALF, BEYOND])
CLAIMS = st.one_of(
    st.just(NO_CLAIM), st.builds(Claim, st.sampled_from([1.0, 1.5, 2.0]), DEPTHS)
)
MIDDLE = np.zeros(2)


def test_the_depths_of_both_arms_leave_a_gap():
    assert pytest.approx(GAP) == SIDE + BEYOND
    assert pytest.approx(GAP) == 2.0 * HALF


@given(CLAIMS, CLAIMS)
def test_of_two_claims_that_exclude_one_another_exactly_one_comes_first(one, other):
    firsts = [
        one.comes_first(other, first=True),
        other.comes_first(one, first=False),
    ]
    if one.depth + other.depth < GAP - 1e-6:
        assert sum(firsts) == 1
    else:
        assert all(firsts)


@given(CLAIMS, CLAIMS)
def test_a_claim_holds_only_from_the_next_update_on(one, other):
    """Until then, the arm does not know what the other one claims at the same time."""
    assert not one.granted(other, one.since, first=True)


def test_a_claim_that_asks_for_more_goes_to_the_end_of_the_queue():
    claim = Claim(1.0, HALF)
    assert claim.changed(BEYOND, 2.0) == Claim(2.0, BEYOND)
    assert Claim(1.0, BEYOND).changed(HALF, 2.0) == Claim(1.0, HALF)
    assert NO_CLAIM.changed(HALF, 2.0) == Claim(2.0, HALF)


def test_a_frontier_is_halfway_between_two_arms():
    bases = np.array([0.0, 0.5, 0.2]), np.array([0.2, -0.3, 0.2])
    sides = Frontier.between(*bases), Frontier.between(*bases[::-1])
    for base, side in zip(bases, sides, strict=True):
        assert side.depth(base) == pytest.approx(0.5 * np.hypot(0.2, 0.8))
        assert side.depth(0.5 * (bases[0] + bases[1])) == pytest.approx(0.0)


class Walled(Motions):
    """Stands in for `WalledMotions`: reaches what is 0.1 m before its wall."""

    def __init__(self, wall):
        super().__init__()
        self.wall = wall
        self.holds_arm = False  # whether an arm that has stopped is behind the wall
        self.refusals = 0

    def contains(self, q):
        return self.holds_arm

    def reaches(self, grasp, room=0.04):
        return WalledMotions.reaches(self, grasp, room)

    def plan(self, q_start, grasp, height_map, number=0, **others):
        if not self.reaches(grasp, 0.1):
            self.unreachable = [tuple(np.round(grasp.p_WC[:2], 6))]
            self.refusals += 1
        motions = super().plan(q_start, grasp, height_map, number, **others)
        self.unreachable = ()
        return motions


class CountedGrasps(Grasps):
    """Counts how often it is asked."""

    def __init__(self, places):
        super().__init__(places)
        self.plans = 0

    def plan(self, height_map, *, tried=(), seed=0):
        self.plans += 1
        return super().plan(height_map, tried=tried, seed=seed)


class Pair:
    """Two arms at once over one table, at x = 0.5 and x = -0.5."""

    def __init__(self, places, config=CONFIG):
        self.places, self.gone, self.trace = list(places), set(), []
        self.stuck = set()  # arms that something holds where they are
        sides = {
            "left": Frontier(MIDDLE, np.array([1.0, 0.0])),
            "right": Frontier(MIDDLE, np.array([-1.0, 0.0])),
        }
        builder = DiagramBuilder()
        self.planners = {}
        for name, side in sides.items():
            motions = [Walled(Wall(side, depth)) for depth in (SIDE, HALF, BEYOND)]
            picks = SharingPickPlanner(
                CountedGrasps(self.places),
                motions,
                config,
                ASIDE,
                first=name == "left",
            )
            planner = SharingPlanner(picks, 4, 4)
            self.planners[name] = builder.AddNamedSystem(name, planner)
        left, right = self.planners.values()
        for one, other in ((left, right), (right, left)):
            source = one.GetOutputPort("claim")
            builder.Connect(source, other.GetInputPort("other_claim"))
        self.simulator = Simulator(builder.Build())
        self.contexts = {
            name: planner.GetMyMutableContextFromRoot(
                self.simulator.get_mutable_context()
            )
            for name, planner in self.planners.items()
        }
        self.feel()

    def table(self):
        shown = HeightMap(np.array([-0.5, 0.0]), 0.01, np.zeros((30, 101)))
        for place in set(self.places) - self.gone:
            away = np.abs(shown.centers() - place)
            shown.height[np.all(away < 0.021, axis=-1)] = TALL
        return shown

    def memory(self, name):
        return self.planners[name].state(self.contexts[name]).memory

    def mode(self, name):
        return self.planners[name].state(self.contexts[name]).mode

    def feel(self):
        """Let both arms follow their commands at once; remove lifted things."""
        for name, planner in self.planners.items():
            context, mode = self.contexts[name], self.mode(name)
            if mode is Mode.TRANSFER:
                p_WC = self.memory(name).planned.grasp.p_WC
                self.gone.add((p_WC[0], p_WC[1]))
            held = mode in (Mode.LIFT, Mode.TRANSFER)
            for port, value in (
                ("grasped", [float(held)]),
                ("gripper_state", HELD if held else np.zeros(8)),
                ("proximity", np.full(4, 0.0 if held else 0.01)),
                ("height_map", self.table()),
            ):
                planner.GetInputPort(port).FixValue(context, value)
            if name not in self.stuck:
                q = planner.GetOutputPort("position_commanded").Eval(context)
                planner.GetInputPort("arm_state").FixValue(context, [*q, 0.0, 0.0])

    def depth(self, name):
        """Return the least depth to which an arm may be [m]."""
        away = self.mode(name) in (*HOLDS, Mode.RETREAT)
        return self.memory(name).claim.depth if away else SIDE

    def step(self):
        """Advance by one step, and return the time [s]."""
        time = self.simulator.get_context().get_time() + STEP
        self.simulator.AdvanceTo(time)
        self.feel()
        return time

    def run(self, limit=120.0):
        """Advance until both are done; collect the time, the modes and the depths."""
        while self.simulator.get_context().get_time() < limit:
            time = self.step()
            modes = {name: self.mode(name) for name in self.planners}
            depths = {name: self.depth(name) for name in self.planners}
            self.trace.append((time, modes, depths))
            if all(mode is Mode.DONE for mode in modes.values()):
                return self
        raise AssertionError(f"still {modes}")

    def longest_rest(self, name):
        rests = [modes[name] is Mode.IDLE for _, modes, _ in self.trace]
        ends = np.flatnonzero(np.diff([False, *rests, False]))
        return STEP * float(np.max(np.diff(ends)[::2], initial=0.0))

    def at_once(self, condition):
        return any(
            all(modes[n] in HOLDS and condition(depths[n]) for n in modes)
            for _, modes, depths in self.trace
        )


PLACES = st.lists(
    st.tuples(st.integers(-9, 9), st.sampled_from([0.05, 0.15, 0.25])),
    min_size=1,
    max_size=6,
    unique=True,
)
ONE_PICK = 6.5  # the time of a pick with these motions, with its look [s]


@settings(max_examples=6, deadline=None)
@given(PLACES)
def test_the_arms_are_always_apart_and_neither_waits_forever(found):
    pair = Pair([(0.05 * i, y) for i, y in found]).run()
    for _, _, depths in pair.trace:
        assert sum(depths.values()) > GAP - 1e-6
    assert pair.gone == set(pair.places)
    for name in pair.planners:
        assert pair.longest_rest(name) < 2.0 * ONE_PICK


def test_in_the_middle_one_arm_waits_for_the_other():
    pair = Pair([(0.0, 0.05), (0.0, 0.15), (0.05, 0.25), (-0.05, 0.25)]).run()
    assert not pair.at_once(lambda depth: True)
    assert {name for name in pair.planners if pair.memory(name).attempts.picks} == {
        "left",
        "right",
    }


@pytest.mark.parametrize("x", [0.2, 0.4])
def test_on_their_own_sides_both_work_at_once(x):
    pair = Pair([(x, 0.05), (-x, 0.05)]).run()
    assert pair.at_once(lambda depth: depth == (HALF if x == 0.2 else SIDE))


def test_one_arm_works_in_the_middle_while_the_other_stays_on_its_side():
    pair = Pair([(0.0, 0.05), (0.4, 0.05), (-0.4, 0.05)]).run()
    assert any(
        all(mode in HOLDS for mode in modes.values())
        and sorted(depths.values()) == [BEYOND, SIDE]
        for _, modes, depths in pair.trace
    )


def plans_while_waiting(pair, place=None):
    """Return how often the right arm plans while the left one is in the middle.

    Args:
        pair: The arms, of which the left one comes first.
        place: Where something comes to lie meanwhile.
    """
    right = pair.planners["right"].planner.grasps
    while pair.mode("left") is not Mode.GRASP:
        pair.step()
    assert pair.mode("right") is Mode.IDLE
    before = right.plans
    if place is not None:
        pair.places.append(place)
    while pair.mode("left") is not Mode.RELEASE:
        pair.step()
    return right.plans - before


def test_an_arm_that_waits_plans_only_if_there_is_news():
    middle = [(0.0, 0.05), (0.0, 0.15)]
    assert plans_while_waiting(Pair(middle)) == 0
    pair = Pair(middle)
    assert plans_while_waiting(pair, (-0.4, 0.25)) == 1
    assert pair.memory("right").planned.grasp.p_WC[0] == pytest.approx(-0.4)


def test_a_plan_tries_no_grasp_twice_at_one_depth():
    pair = Pair([(-0.1, 0.05)])
    memory, picks = SharingMemory(HERE), pair.planners["left"].planner
    seen = pair.planners["left"]._cropped(pair.table(), NO_CLAIM, NO_CLAIM)
    picks.plan(memory, seen, 0.0)
    assert [motions.refusals for motions in picks.by_depth] == [0, 0, 1]
    assert [thing.failure for thing in memory.left] == [Failure.OUT_OF_REACH]


def failed_in_the_middle(*others):
    """Return a pair whose right arm is stuck in the middle and has failed."""
    pair = Pair([(-0.05, 0.05), *others])
    while not (pair.mode("right") is Mode.GRASP and pair.depth("right") == BEYOND):
        pair.step()
    pair.stuck.add("right")
    while pair.mode("right") is not Mode.FAILED:
        pair.step()
    return pair


def done(pair, name, limit=60.0):
    """Advance until an arm is done."""
    while pair.mode(name) is not Mode.DONE and pair.step() < limit:
        pass
    return pair.mode(name) is Mode.DONE


@pytest.mark.parametrize("looks", [False, True])
def test_an_arm_that_has_failed_in_the_middle_blocks_it_but_nothing_else(looks):
    middle, side, free = (0.05, 0.15), (0.4, 0.05), (0.4, 0.25)
    pair = failed_in_the_middle(middle, side)
    if looks:  # its last look does not show its last load
        port = pair.planners["left"].GetInputPort("destination_map")
        port.FixValue(pair.contexts["left"], table())
    assert pair.memory("right").claim == Claim(-np.inf, BEYOND)
    pair.places.append(free)
    assert done(pair, "left")
    assert pair.gone >= {side, free}
    assert middle not in pair.gone


@pytest.mark.parametrize("depth", [SIDE, HALF])
def test_an_arm_that_has_failed_claims_only_where_it_stands(depth):
    pair = Pair([(-0.05, 0.05), (0.05, 0.15), (0.2, 0.25)])
    for motions in pair.planners["right"].planner.by_depth:
        motions.holds_arm = motions.wall.depth <= depth
    pair.stuck.add("right")
    while pair.mode("right") is not Mode.FAILED:
        pair.step()
    claim = pair.memory("right").claim
    assert claim == (NO_CLAIM if depth == SIDE else Claim(-np.inf, HALF))
    assert done(pair, "left")
    assert (0.2, 0.25) in pair.gone
    assert ((0.05, 0.15) in pair.gone) == (depth == SIDE)


def test_without_turns_the_arms_would_meet(monkeypatch):
    """The check above sees it."""
    monkeypatch.setattr(Claim, "granted", lambda *_, **__: True)
    pair = Pair([(0.0, 0.05), (0.0, 0.15), (0.0, 0.25)]).run()
    assert any(sum(depths.values()) < GAP - 1e-6 for _, _, depths in pair.trace)


@pytest.mark.parametrize(
    ("claim", "other", "shown", "least"),
    [
        (NO_CLAIM, NO_CLAIM, BEYOND, BEYOND),
        (NO_CLAIM, Claim(1.0, HALF), 0.0, HALF),
        (NO_CLAIM, Claim(1.0, BEYOND), HALF - BEYOND, SIDE),
        (Claim(0.5, HALF), Claim(1.0, BEYOND), BEYOND, BEYOND),  # which waits
        (Claim(2.0, HALF), Claim(1.0, BEYOND), HALF - BEYOND, SIDE),
    ],
)
def test_a_map_leaves_out_where_the_other_arm_may_be(claim, other, shown, least):
    pair = Pair([(0.0, 0.05)])
    seen = pair.planners["left"]._cropped(pair.table(), claim, other)
    x = seen.centers()[..., 0]
    np.testing.assert_array_equal(np.isfinite(seen.height), x > shown)
    assert seen.least == pytest.approx(least)
    assert seen.wanted == (claim == Claim(0.5, HALF))


def report(**given):
    return dc.replace(PlannerStatus(attempts=2, cycles=1, localized_at=1.0), **given)


def test_the_joint_status_ends_with_the_last_arm():
    far = Remaining(np.zeros(3), Failure.OUT_OF_REACH)
    done = report(mode=Mode.DONE, left=(far,))
    works = report(mode=Mode.LIFT, localized_at=0.5)
    joint = joint_status({"left": done, "right": works})
    assert joint.mode is Mode.LIFT
    assert (joint.attempts, joint.cycles, joint.localized_at) == (4, 2, 0.5)
    both = joint_status({"left": done, "right": done})
    assert both.done
    assert both.left == (far, far)
    failed = report(mode=Mode.FAILED, failure=Failure.STOPPED, message="stuck")
    ended = joint_status({"left": done, "right": failed})
    assert (ended.failure, ended.message) == (Failure.STOPPED, "right: stuck")
    assert not joint_status({"left": failed, "right": works}).ended


def test_a_system_reports_the_joint_status():
    system = JointStatus(["left", "right"])
    context = system.CreateDefaultContext()
    for name in ("left", "right"):
        port = system.GetInputPort(f"{name}.status")
        port.FixValue(context, Value(report(mode=Mode.DONE)))
    assert system.GetOutputPort("mode").Eval(context) is Mode.DONE
    assert system.GetOutputPort("status").Eval(context).cycles == 2


@pytest.fixture(scope="module")
def pair():
    return MakeClearingPair(load_scenario("clear_table_together"))


def test_an_arm_at_home_is_in_nobodys_way(pair):
    for name in ("left", "right"):
        motions = pair.GetSubsystemByName(name).planner.motions
        assert motions.wall.depth == SIDE
        assert motions.scene.is_free(motions.q_home)
        assert motions.scene.is_free(motions.q_over)


@pytest.mark.parametrize(("end", "cut"), [(0.0, True), (0.045, False)])
def test_a_thing_that_the_map_cuts_off_stays(pair, end, cut):
    """It may be wider than it seems, or longer."""
    _, half, _ = pair.GetSubsystemByName("left").planner.by_depth
    shown = SharedHeightMap(
        np.array([0.2, 0.0]), 0.005, np.zeros((80, 100), np.float32), least=HALF
    )
    x, y = np.moveaxis(shown.centers(), -1, 0)
    shown.height[(abs(x - 0.5) < 0.02) & (y > end) & (y < 0.16)] = TALL
    shown.height[y < shown.edge] = np.nan
    planned = half.plan(half.q_home, grasp_at((0.5, 0.11)), shown)
    refused = isinstance(planned, PlanningFailure) and "reaches over" in planned.message
    assert refused == cut


def test_walls_stop_an_arm_at_its_depth(pair):
    picks = pair.GetSubsystemByName("left").planner
    scenes = [motions.scene for motions in picks.by_depth]
    freed = []
    for turn in np.linspace(0.85, -1.9, 100):
        q = np.array([turn, *picks.motions.q_home[1:]])
        free = [scene.is_free(q) for scene in scenes]
        # Whatever is free at one depth is free beyond it, too.
        assert free == sorted(free)
        assert picks.depth_of(q) == (SIDE if free[0] else HALF if free[1] else BEYOND)
        freed.append(sum(free))
    assert {0, 1, 2, 3} <= set(freed)
