"""The motions to a load's destination, with the scenario's own arm and bin."""

import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.planning.clearing import placing
from drake_srg.planning.clearing.destination import Spot, Spots
from drake_srg.planning.clearing.motions import HeldLoad
from drake_srg.planning.clearing.placing import laying_targets
from drake_srg.planning.grasps.top_grasps import palm_pose
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.scenario import load_scenario
from drake_srg.station.clearing import MakeClearingPlanner
from drake_srg.station.perception import bin_boxes, bin_floor, row_places
from drake_srg.types import Mode
from planning.clearing.fake_table import SIDE, grasp_at, moved, table

OVER = np.array([0.3, -0.5, 0.6])  # the palm over the bin
PALM = 0.18  # above the underside of a load
BELOW = 0.02  # the grasp, above it


def way(yaw, middle, sag, ground=0.02, aside=(0.0, 0.0, 0.0), high=0.5):
    """Return the hand's poses, and the load."""
    load = HeldLoad(
        p_GC=np.zeros(3),
        below=BELOW,
        sag=sag,
        long=True,
        middle_G=np.array([0.0, 0.0, middle]),
    )
    targets = laying_targets(
        palm_pose(OVER, yaw), load, PALM, Spot(np.array(aside), ground), high
    )
    return [RigidTransform(t.R_WG, t.p_WT) for t in targets], load


yaws = st.floats(-np.pi, np.pi)
middles = st.floats(0.02, 0.12) | st.floats(-0.12, -0.02)


@given(yaws, middles, st.floats(0.02, 0.22))
def test_a_load_that_hangs_turns_about_the_end_it_stands_on(yaw, middle, sag):
    """The hand keeps its distance from the end on which the load stands."""
    _, *arc = way(yaw, middle, sag)[0]
    # The pivot: straight below the hand when it begins to turn, at the height of the
    # hand when the load lies.
    p_W = np.array([*arc[0].translation()[:2], arc[-1].translation()[2]])
    for X_WG in arc:
        apart = np.linalg.norm(X_WG.translation() - p_W)
        assert apart == pytest.approx(sag, abs=1e-9)


@given(yaws, middles, st.floats(0.02, 0.22), st.floats(0.0, 0.2))
def test_the_middle_of_the_load_lies_in_the_middle_of_its_lane(
    yaw, middle, sag, ground
):
    aside = np.array([0.05, -0.08, 0.0])
    poses, load = way(yaw, middle, sag, ground, aside)
    p_W = poses[-1].translation() + poses[-1].rotation() @ load.middle_G
    np.testing.assert_allclose(p_W[:2], (OVER + aside)[:2], atol=1e-9)
    underside = poses[-1].translation()[2] - PALM
    assert ground < underside < ground + 0.03


@given(yaws, middles, st.floats(0.02, 0.22))
def test_it_begins_high_and_only_goes_down_without_turning(yaw, middle, sag):
    poses, _ = way(yaw, middle, sag)
    heights = [X_WG.translation()[2] for X_WG in poses]
    assert heights[0] == pytest.approx(max(0.5, heights[1]))
    assert all(np.diff(heights) <= 1e-9)
    for X_WG in poses:
        R_error: RotationMatrix = X_WG.rotation() @ poses[0].rotation().inverse()
        assert R_error.ToAngleAxis().angle() < 1e-6


def test_the_far_end_of_the_load_does_not_hit_the_far_wall_when_it_lies():
    """A level load goes down at the side to which a hanging one turns."""
    poses, _ = way(0.0, 0.1, 0.2)
    outward = poses[0].rotation().col(2)
    shifts = [(X.translation() - poses[-1].translation()) @ outward for X in poses]
    assert shifts[1] == pytest.approx(0.2)
    assert all(np.diff(shifts) <= 1e-9)


@given(yaws, st.floats(-0.1, 0.1), st.floats(0.0, 0.2))
def test_what_does_not_turn_goes_straight_down(yaw, middle, ground):
    high, low = way(yaw, middle, 0.0, ground)[0]
    np.testing.assert_allclose(low.translation()[:2], high.translation()[:2])
    assert low.translation()[2] == pytest.approx(ground + PALM + 0.02)
    assert high.translation()[2] >= low.translation()[2]


PLACE = (0.55, 0.05)


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("clear_table", overrides=["clutter.count=1"])


@pytest.fixture(scope="module")
def motions(scenario):
    return MakeClearingPlanner(scenario).planner.motions


def long_thing(height_map, length):
    """Lay a bar on the map, from the grasp on along x."""
    offsets = height_map.centers() - PLACE
    inside = (np.abs(offsets[..., 1]) < 0.02) & (
        np.abs(offsets[..., 0] - 0.5 * length) < 0.5 * length + 0.02
    )
    height_map.height[inside] = 0.03
    return height_map


@pytest.mark.parametrize("length", [0.0, 0.1])
@pytest.mark.parametrize(("turned", "number"), [(False, 0), (True, 1), (False, 2)])
def test_loads_are_dropped_in_the_middle_of_the_bin_and_beside_it(
    scenario, motions, length, turned, number
):
    height_map = long_thing(moved(table()), length)
    grasp = grasp_at(PLACE)
    planned = motions.plan(
        motions.q_home, grasp.half_turn() if turned else grasp, height_map, number
    )
    assert not isinstance(planned, PlanningFailure), planned.message
    at_grasp = motions.scene.X_WG(planned[Mode.GRASP].value(1e9)[:, 0])
    over_bin = motions.scene.X_WG(planned[Mode.TRANSFER].value(1e9)[:, 0])
    # A long load is level or hangs. The bin's middle is halfway between both.
    middle = np.array([PLACE[0] + 0.25 * length, PLACE[1], 0.0])
    p_W = over_bin @ (at_grasp.inverse() @ middle)
    low, high = bin_boxes(scenario)["bin"]
    aside = (0.0, 0.13, -0.13)[number] if length == 0.0 else 0.0
    expected = 0.5 * (low + high)[:2] + [aside, 0.0]
    np.testing.assert_allclose(p_W[:2], expected, atol=0.005)
    assert p_W[2] > high[2]  # what stood on the table clears the rim


def test_the_arm_rests_only_at_the_grasp_and_over_the_bin(motions):
    """With a load that may hang from the hand, it also rests above the table."""

    def rests(grasp, height_map):
        planned = motions.plan(motions.q_home, grasp, height_map)
        speeds = {
            mode: np.max(np.abs(motion.EvalDerivative(motion.end_time(), 1)))
            for mode, motion in planned.items()
        }
        return [mode for mode, speed in speeds.items() if speed < 1e-6]

    assert rests(grasp_at(PLACE), moved(table())) == [Mode.GRASP, Mode.TRANSFER]
    hanging = bar_at(PLACE, -0.1, 0.2)
    assert rests(*hanging) == [Mode.GRASP, Mode.LIFT, Mode.TRANSFER]


@pytest.mark.parametrize(
    "key",
    [
        "planner.cut_corners=false",
        "safety={}",
        "planner.tip_limits={velocity: 0.5, acceleration: 1.0}",
    ],
)
def test_where_the_next_motion_might_be_late_the_arm_rests(key):
    scenario = load_scenario("clear_table", overrides=["clutter.count=1", key])
    resting = MakeClearingPlanner(scenario).planner.motions
    planned = resting.plan(resting.q_home, grasp_at(PLACE), moved(table(PLACE)))
    assert not isinstance(planned, PlanningFailure), planned.message
    for motion in planned.values():
        end = motion.EvalDerivative(motion.end_time(), 1)
        np.testing.assert_allclose(end, 0.0, atol=1e-6)


def test_far_out_a_long_load_is_lifted_less(motions):
    far = (0.78, 0.05)
    assert 0.1 < risen(motions, *bar_at(far)) < risen(motions, *bar_at(PLACE)) - 0.05


@pytest.mark.parametrize("length", [0.06, 0.12, 0.18])
def test_a_load_clears_the_rim_even_if_it_hangs_from_the_pads(
    scenario, motions, length
):
    """It may turn about the line between the pads until its longer end is down."""
    (_, high), far_end = bin_boxes(scenario)["bin"], 0.7 * length
    grasp, height_map = bar_at(PLACE, -0.3 * length, far_end)
    lowest = grasp.p_WC[2] + risen(motions, grasp, height_map) - far_end
    assert lowest > high[2] + 0.02
    # Held across that line, it stays level, and needs only its own height.
    turned = dc.replace(grasp, X_WG=palm_pose(grasp.X_WG.translation(), 0.5 * np.pi))
    assert risen(motions, turned, height_map) < risen(motions, grasp, height_map)


@pytest.mark.parametrize(("turn", "slower"), [(0.0, 0.6), (0.5 * np.pi, 1.0)])
def test_what_hangs_from_the_pads_is_lifted_gently(monkeypatch, motions, turn, slower):
    """Regression: a hammer swung, and slipped out of the hand."""
    grasp, height_map = bar_at(PLACE, -0.1, 0.2)
    grasp = dc.replace(grasp, X_WG=palm_pose(grasp.X_WG.translation(), turn))
    gently = lifting(motions, grasp, height_map).end_time()
    monkeypatch.setattr(placing, "_GENTLE", 1.0)
    fast = lifting(motions, grasp, height_map).end_time()
    assert fast == pytest.approx(slower * gently, rel=0.1)  # torques limit it, too


def test_far_out_a_load_that_hangs_is_drawn_in_before_it_crosses_the_rim(
    scenario, motions
):
    grasp, height_map = bar_at((0.78, 0.05), -0.1, 0.2)
    planned = motions.plan(motions.q_home, grasp, height_map)
    assert not isinstance(planned, PlanningFailure), planned.message
    low, high = bin_boxes(scenario)["bin"]
    p_GC = grasp.X_WG.inverse() @ grasp.p_WC
    way = planned[Mode.TRANSFER]
    over = []
    for time in np.linspace(way.start_time(), way.end_time(), 60):
        p_WC = motions.scene.X_WG(way.value(time)[:, 0]) @ p_GC
        if np.all(p_WC[:2] > low[:2]) and np.all(p_WC[:2] < high[:2]):
            over.append(p_WC[2] - 0.2)
    assert over
    assert min(over) > high[2]


def test_loads_are_carried_over_what_is_in_the_bin(scenario, motions):
    filled = bin_boxes(scenario)["bin"][1][2] + 0.1
    planned = motions.plan(
        motions.q_home, grasp_at(PLACE), moved(table(PLACE)), filled=filled
    )
    assert not isinstance(planned, PlanningFailure), planned.message
    below = grasp_at(PLACE).X_WG.translation()[2]  # the palm's origin, to the table
    for mode in (Mode.LIFT, Mode.TRANSFER):
        end = planned[mode].value(1e9)[:, 0]
        assert motions.scene.X_WG(end).translation()[2] > filled + below + 0.02


@pytest.mark.parametrize("middle", [0.07, -0.07])
def test_a_long_load_is_laid_down_in_a_lane(scenario, motions, middle):
    low, high = bin_boxes(scenario)["bin"]
    floor = bin_floor(scenario, "bin")
    lane = Spot(np.array([0.0, 0.08, 0.0]), floor)
    grasp, height_map = bar_at(PLACE, middle - 0.1, middle + 0.1)
    planned = motions.plan(motions.q_home, grasp, height_map, spots=Spots(long=(lane,)))
    assert not isinstance(planned, PlanningFailure), planned.message
    laying = planned[Mode.PLACE]
    np.testing.assert_allclose(
        laying.value(0.0)[:, 0], planned[Mode.TRANSFER].value(1e9)[:, 0], atol=1e-6
    )
    at_grasp = motions.scene.X_WG(planned[Mode.GRASP].value(1e9)[:, 0])
    laid = motions.scene.X_WG(laying.value(1e9)[:, 0])
    ends = [
        laid @ (at_grasp.inverse() @ np.array([PLACE[0], PLACE[1] + end, 0.0]))
        for end in (middle - 0.1, middle + 0.1)
    ]
    p_W = np.mean(ends, axis=0)
    np.testing.assert_allclose(p_W[:2], (low + high)[:2] / 2 + [0, 0.08], atol=0.01)
    assert floor < p_W[2] < floor + 0.03
    for end in ends:  # along the bin, all of it inside
        assert np.all(end[:2] > low[:2] + 0.03)
        assert np.all(end[:2] < high[:2] - 0.03)


def test_where_a_load_cannot_be_laid_down_it_is_dropped(motions):
    grasp, height_map = bar_at(PLACE, -0.03, 0.17)
    lane = Spot(np.array([0.0, 0.08, 0.0]), -1.0)  # below the table
    planned = motions.plan(motions.q_home, grasp, height_map, spots=Spots(long=(lane,)))
    assert not isinstance(planned, PlanningFailure), planned.message
    assert Mode.PLACE not in planned


@pytest.mark.parametrize("kind", ["long", "tall"])
def test_low_and_short_loads_are_dropped(motions, kind):
    spots = Spots(**{kind: (Spot(np.array([0.0, 0.08, 0.0]), 0.02),)})
    planned = motions.plan(
        motions.q_home, grasp_at(PLACE), moved(table(PLACE)), spots=spots
    )
    assert Mode.PLACE not in planned


def test_a_tall_load_is_set_down_at_a_spot(scenario, motions):
    """Dropped from above the rim, a pitcher toppled over it."""
    low, high = bin_boxes(scenario)["bin"]
    floor = bin_floor(scenario, "bin")
    grasp = grasp_at(PLACE)
    up = RigidTransform([0.0, 0.0, 0.15])
    grasp = dc.replace(
        grasp, X_WG=up @ grasp.X_WG, p_WC=up @ grasp.p_WC, height=grasp.height + 0.15
    )
    spots = Spots(
        long=(Spot(np.zeros(3), floor),),
        tall=(Spot(np.array([0.1, 0.0, 0.0]), floor),),
    )
    planned = motions.plan(
        motions.q_home, grasp, moved(table(PLACE, tall=0.2)), spots=spots
    )
    assert not isinstance(planned, PlanningFailure), planned.message
    p_WG = motions.scene.X_WG(planned[Mode.PLACE].value(1e9)[:, 0]).translation()
    np.testing.assert_allclose(p_WG[:2], (low + high)[:2] / 2 + [0.1, 0.0], atol=0.01)
    above_floor = p_WG[2] - grasp.X_WG.translation()[2] - floor
    assert 0.0 < above_floor < 0.03


def lifting(motions, grasp, height_map):
    """Return the lift of a grasp."""
    planned = motions.plan(motions.q_home, grasp, height_map)
    assert not isinstance(planned, PlanningFailure), planned.message
    return planned[Mode.LIFT]


def risen(motions, grasp, height_map):
    """Return how high a grasp is lifted straight up [m]."""
    lift = lifting(motions, grasp, height_map)
    times = np.linspace(lift.start_time(), lift.end_time(), 200)
    way = [motions.scene.X_WG(lift.value(t)[:, 0]).translation() for t in times]
    way = np.array(way) - way[0]
    return np.max(way[np.linalg.norm(way[:, :2], axis=1) < 0.02, 2])


def bar_at(place, low=-0.2, high=0.2):
    """Return a grasp across a bar along y, from `low` to `high`, and its map [m]."""
    height_map = moved(table())
    x, y = np.moveaxis(height_map.centers() - place, -1, 0)
    height_map.height[(np.abs(x) < 0.02) & (y > low) & (y < high)] = 0.03
    return grasp_at(place), height_map


@pytest.fixture(scope="module")
def scenario_of_row_motions():
    return load_scenario("row_table")


@pytest.fixture(scope="module")
def planner(scenario_of_row_motions):
    return MakeClearingPlanner(scenario_of_row_motions).planner


@pytest.mark.parametrize("slot", [0, 3])
def test_a_thing_is_set_down_as_it_stood_at_its_own_place(
    scenario_of_row_motions, planner, slot
):
    motions = planner._by_label[slot]
    planned = motions.plan(motions.q_home, grasp_at(PLACE), moved(table()))
    assert not isinstance(planned, PlanningFailure), planned.message
    at_grasp, at_place = (
        motions.scene.X_WG(planned[mode].value(1e9)[:, 0])
        for mode in (Mode.GRASP, Mode.PLACE)
    )
    X_OO = at_place @ at_grasp.inverse()  # motion of the thing
    p_WO = X_OO @ np.array([*PLACE, 0.0])
    name = scenario_of_row_motions.task.clear.objects[slot]
    np.testing.assert_allclose(
        p_WO[:2], row_places(scenario_of_row_motions)[name][:2], atol=0.003
    )
    assert 0.0 < p_WO[2] < 0.003
    assert X_OO.rotation().matrix()[2, 2] == pytest.approx(1.0, abs=1e-4)
    # The fingers close across the row, and do not touch what stands beside.
    assert abs(at_place.rotation().matrix()[1, 1]) > 0.99
    assert scenario_of_row_motions.task.place.row.spacing > 2 * SIDE
