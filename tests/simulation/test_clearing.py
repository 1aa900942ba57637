"""Judging runs that clear a table, from made-up logs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.common.log_format import MODES, pose_to_row, row_to_pose
from drake_srg.objects.household import object_facts
from drake_srg.scenario import load_scenario, robot_arms
from drake_srg.simulation.clearing import clearing_outcome, delivered, least_width
from drake_srg.simulation.measures import hand_poses
from drake_srg.simulation.metrics import RunTimes, calc_metrics
from drake_srg.station.perception import bin_boxes, row_places
from drake_srg.types import Failure, Mode, PlannerStatus, Remaining

IN_BIN, ON_TABLE = [0.34, -0.56, 0.05], [0.6, 0.1, 0.025]
A, B = "clutter_1", "clutter_2"


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("clear_table", overrides=["clutter.count=2"])


def log(scenario, ends, modes):
    """Return the log of a run in which objects rest where they are at the end."""
    rows = len(modes)
    home = [*scenario.arm.home, *[0.0] * 7]
    poses = {n: pose_to_row(RigidTransform(np.array(p))) for n, p in ends.items()}
    return {
        "time": 0.05 * np.arange(rows),
        "mode": np.array([MODES.index(mode) for mode in modes], dtype=float),
        "arm.state_measured": np.tile(home, (rows, 1)),
        **{f"object_pose.{n}": np.tile(row, (rows, 1)) for n, row in poses.items()},
    }


MODES_OF_A_PICK = [Mode.IDLE, Mode.GRASP, Mode.CLOSE, Mode.CLOSE, Mode.DONE]


def outcome(scenario, ends, **status):
    made = log(scenario, ends, MODES_OF_A_PICK)
    return clearing_outcome(scenario, made, PlannerStatus(mode=Mode.DONE, **status))


def test_bin_of_the_scenario(scenario):
    low, high = bin_boxes(scenario)["bin"]
    np.testing.assert_allclose(low, [0.04, -0.76, 0.0], atol=1e-9)
    np.testing.assert_allclose(high, [0.64, -0.36, 0.12], atol=1e-9)


def test_counts_what_is_in_the_bin(scenario):
    found = outcome(scenario, {A: IN_BIN, B: IN_BIN}, attempts=3, cycles=2)
    assert found.metrics()["objects_cleared"] == 2
    assert found.metrics()["picks_held"] == 2
    assert found.picks_per_hour == pytest.approx(36000.0)  # two in 0.2 s
    assert found.report_is_true


def test_a_robots_log_does_not_tell_what_became_of_the_objects(scenario):
    made = log(scenario, {}, MODES_OF_A_PICK)
    status = PlannerStatus(mode=Mode.DONE, attempts=3, cycles=2)
    times = RunTimes(simulated=0.2, wall=0.2)
    metrics = calc_metrics(scenario, "clear_table", made, status, set(), times, {})
    assert (metrics.attempts, metrics.cycles) == (3, 2)
    assert metrics.objects is metrics.objects_total is None


@settings(max_examples=20)  # each measures the objects anew
@given(st.floats(-np.pi, np.pi), st.floats(0.0, 0.2))
def test_what_lies_beside_the_bin_is_not_in_it(scenario, direction, far):
    low, high = bin_boxes(scenario)["bin"]
    # From the middle through its side, and a little or a lot further.
    x, y = np.cos(direction), np.sin(direction)
    half = 0.5 * (high - low)[:2]
    reach = 0.001 + far + min(half[0] / max(abs(x), 1e-9), half[1] / max(abs(y), 1e-9))
    beside = [*(0.5 * (low + high)[:2] + reach * np.array([x, y])), 0.05]
    found = outcome(scenario, {A: IN_BIN, B: beside})
    assert (found.objects[A].cleared, found.objects[B].cleared) == (True, False)


def test_what_is_left_needs_a_reason(scenario):
    ends = {A: IN_BIN, B: ON_TABLE}
    assert not outcome(scenario, ends).report_is_true
    elsewhere = Remaining(np.array([0.9, 0.1, 0.05]), Failure.TOO_WIDE)
    assert not outcome(scenario, ends, left=(elsewhere,)).report_is_true
    there = Remaining(np.array([0.6, 0.1, 0.05]), Failure.TOO_WIDE)
    found = outcome(scenario, ends, left=(elsewhere, there))
    assert found.report_is_true
    assert found.objects[B].outcome == "too_wide"


def test_a_load_that_missed_the_bin_was_dropped(scenario):
    lost = Remaining(np.array([0.34, -0.56, 0.0]), Failure.DROPPED)
    ends = {A: [0.34, -0.3, 0.05], B: ON_TABLE}
    found = outcome(scenario, ends, left=(lost,))
    assert [thing.outcome for thing in found.objects.values()] == [
        *("dropped", "not_seen")
    ]
    seen = Remaining(np.array([0.6, 0.1, 0.05]), Failure.TOO_WIDE)
    found = outcome(scenario, ends, left=(seen, lost))
    assert found.objects[B].outcome == "too_wide"
    assert not found.report_is_true  # it was to be cleared


@given(st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3))
def test_objects_tell_how_far_they_have_moved(scenario, way):
    made = log(scenario, {A: IN_BIN, B: ON_TABLE}, [Mode.IDLE, Mode.PRE_GRASP] * 2)
    made[f"object_pose.{A}"] = made[f"object_pose.{A}"].copy()
    made[f"object_pose.{A}"][0, :3] += 1.0  # before the first pick
    made[f"object_pose.{A}"][2:, :3] += way
    found = clearing_outcome(scenario, made, PlannerStatus(mode=Mode.DONE))
    assert found.objects[A].moved_m == pytest.approx(np.linalg.norm(way), abs=1e-9)
    facts = object_facts(A, scenario.objects[A])
    middle = 0.5 * (facts.low + facts.high)
    lay_at = row_to_pose(made[f"object_pose.{A}"][1]) @ middle
    np.testing.assert_allclose(found.objects[A].lay_at_m, lay_at[:2], atol=1e-9)
    assert found.objects[B].moved_m == 0.0


@settings(max_examples=20)  # each measures the objects anew
@given(st.floats(-0.1, 0.1), st.booleans())
def test_objects_tell_what_lies_over_them(x, below):
    model = "package://drake_srg/sdf/029_plate.sdf"
    ball = "{shape: !Sphere {radius: 0.02}, mass: 0.05, friction: 0.5}"
    things = f"{{plate: {{model: {model}}}, ball: {ball}}}"
    overrides = ["clutter.count=0", f"objects={things}"]
    scenario = load_scenario("clear_table", overrides=overrides)
    z = -0.01 if below else 0.05
    found = outcome(scenario, {"plate": [0.6, 0.1, 0.03], "ball": [0.6 + x, 0.1, z]})
    assert found.objects["ball"].under == ("plate" if below else "")
    assert (found.objects["plate"].under == "ball") == (not below and abs(x) < 0.02)


def test_a_claim_too_many_is_not_honest(scenario):
    assert not outcome(scenario, {A: IN_BIN, B: IN_BIN}, cycles=3).report_is_true


def test_a_grasp_counts_for_the_nearest_object(scenario):
    found = outcome(scenario, {A: IN_BIN, B: ON_TABLE})
    assert sum(thing.attempts for thing in found.objects.values()) == 1
    assert found.objects[A].attempts == 1  # home is over the bin


def test_a_grasp_counts_for_nothing_where_nothing_belongs_into_a_bin():
    overrides = ["task.pick={colour: pink}", "task.place={bin: red_bin, bins: null}"]
    scenario = load_scenario("sort_table", overrides=overrides)
    found = outcome(scenario, dict.fromkeys(scenario.objects, ON_TABLE))
    assert found.objects == {}
    assert found.report_is_true


RED_BIN, BLUE_BIN = [0.3, -0.55, 0.05], [0.3, 0.55, 0.05]


@pytest.fixture(scope="module")
def sorting():
    """Return `sort_table`, and where everything is once it is sorted."""
    scenario = load_scenario("sort_table")
    bins = {"red": RED_BIN, "blue": BLUE_BIN, "green": ON_TABLE}
    ends = {name: bins[name.partition("_")[0]] for name in scenario.objects}
    return scenario, ends


def test_sorted_objects_are_in_their_own_bins(sorting):
    found = outcome(*sorting, attempts=6, cycles=6)
    assert "green_block" not in found.objects  # it belongs into neither
    assert found.metrics()["objects_sorted"] == 6
    assert found.metrics()["objects_in_wrong_bin"] == 0
    assert found.others_moved == 0.0
    assert found.report_is_true


@given(st.floats(0.02, 0.2), st.floats(0.02, 0.2), st.floats(-np.pi, np.pi))
def test_the_least_width_of_a_rectangle_is_its_shorter_side(a, b, yaw):
    corners = 0.5 * np.array([[a, b], [a, -b], [-a, b], [-a, -b]])
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    # Directions are half a degree off at most.
    most = min(a, b) + max(a, b) * np.sin(np.deg2rad(0.5)) + 1e-9
    assert min(a, b) - 1e-9 <= least_width(corners @ turn.T) <= most


def test_a_jug_on_its_head_is_in_the_bin_though_its_origin_is_above():
    jug = {"model": "package://drake_srg/sdf/019_pitcher_base.sdf"}
    scenario = load_scenario(
        "clear_table", overrides=["clutter.count=0", f"objects={{jug: {jug}}}"]
    )
    poses = log(scenario, {"jug": IN_BIN}, MODES_OF_A_PICK)
    bottom = np.array([*IN_BIN[:2], 0.26])
    on_its_head = RigidTransform(RotationMatrix.MakeXRotation(np.pi), bottom)
    poses["object_pose.jug"][:] = pose_to_row(on_its_head)
    found = clearing_outcome(scenario, poses, PlannerStatus(mode=Mode.DONE))
    assert found.objects["jug"].cleared


@pytest.mark.parametrize("name", ["red_can", "green_block"])
def test_what_is_in_the_wrong_bin_is_told(sorting, name):
    scenario, ends = sorting
    found = outcome(scenario, ends | {name: BLUE_BIN}, attempts=6, cycles=5)
    assert found.in_wrong_bin == (name,)
    assert not found.report_is_true
    if name == "red_can":
        assert found.objects[name].outcome == "wrong_bin"
        assert found.metrics()["objects_sorted"] == 5


def test_what_must_stay_is_measured_from_where_it_came_to_rest(sorting):
    scenario, ends = sorting
    made = log(scenario, ends, MODES_OF_A_PICK)
    x = made["object_pose.green_block"][:, 0]
    x += [0.5, 0.0, 0.0, 0.003, 0.0]  # it falls, rests, and is pushed and back
    status = PlannerStatus(mode=Mode.DONE, localized_at=made["time"][1], attempts=1)
    found = clearing_outcome(scenario, made, status)
    assert found.others_moved == pytest.approx(0.003)
    idle = PlannerStatus(mode=Mode.FAILED)  # nothing was picked, so nothing rested yet
    assert clearing_outcome(scenario, made, idle).others_moved is None


def test_in_a_row_things_must_stand_at_their_own_places():
    scenario = load_scenario("row_table")
    places = row_places(scenario)
    ends = {name: [*p[:2], 0.025] for name, p in places.items()}
    assert outcome(scenario, ends, attempts=4, cycles=4).cleared == 4
    swapped = ends | {"red_can": ends["blue_can"], "blue_can": ends["red_can"]}
    assert outcome(scenario, swapped).cleared == 2
    off = ends | {"red_can": np.add(ends["red_can"], [0.011, 0.0, 0.0])}
    assert not outcome(scenario, off).objects["red_can"].cleared


@pytest.mark.parametrize("rise", [0.05, 0.15])
@pytest.mark.parametrize("carried", [[], [A], [A, B]])
def test_what_one_grasp_has_carried_together_is_told(scenario, carried, rise):
    modes = [Mode.PRE_GRASP, Mode.CLOSE, Mode.CLOSE, Mode.TRANSFER, Mode.DONE]
    made = log(scenario, {A: ON_TABLE, B: ON_TABLE}, modes)
    for name in carried:
        made[f"object_pose.{name}"] = made[f"object_pose.{name}"].copy()
        made[f"object_pose.{name}"][3, 2] += rise
    status = PlannerStatus(mode=Mode.DONE, attempts=1, cycles=1, multi_object_picks=1)
    found = clearing_outcome(scenario, made, status)
    together = {A: B, B: A} if len(carried) == 2 and rise > 0.1 else {}
    told = {n: o.carried_with for n, o in found.objects.items() if o.carried_with}
    assert told == together
    assert found.metrics()["multi_object_picks"] == bool(together)
    assert found.metrics()["multi_object_picks_seen"] == 1


@pytest.mark.parametrize(
    ("loads", "cleared", "expected"),
    [
        ([], [A], 0),
        ([[A], [B]], [A, B], 2),
        ([[A], [B]], [B], 1),  # one fell beside the bin
        ([[A, B]], [A, B], 1),
        ([[A], [], [A]], [A], 1),  # it fell out, and was taken again
        ([[A, B], [B]], [A, B], 2),
    ],
)
def test_a_pick_delivers_what_rests_where_it_belongs(loads, cleared, expected):
    assert delivered(loads, cleared) == expected


def test_deliveries_are_told(scenario):
    modes = [Mode.PRE_GRASP, Mode.CLOSE, Mode.CLOSE, Mode.TRANSFER, *3 * [Mode.DONE]]
    made = log(scenario, {A: IN_BIN, B: ON_TABLE}, modes)
    pose = made[f"object_pose.{A}"] = made[f"object_pose.{A}"].copy()
    pose[:3, 2] -= 0.15
    status = PlannerStatus(mode=Mode.DONE, attempts=1)
    metrics = clearing_outcome(scenario, made, status).metrics()
    assert metrics["picks_delivered"] == 1
    assert metrics["picks_held"] == 0  # by the planner's word


def test_of_two_arms_each_carries_what_is_near_its_hand():
    scenario = load_scenario("clear_table_together", overrides=["clutter.count=2"])
    modes = [Mode.IDLE, Mode.PRE_GRASP, Mode.CLOSE, Mode.TRANSFER, Mode.RELEASE]
    modes += 4 * [Mode.DONE]  # at rest
    made = {
        "time": 0.05 * np.arange(len(modes)),
        "mode": np.array([MODES.index(mode) for mode in modes], float),
    }
    for arm, thing in zip(robot_arms(scenario), (A, B), strict=True):
        state = np.tile([*arm.arm.home, *[0.0] * 7], (len(modes), 1))
        (X_WG,) = hand_poses(scenario, state[:1], arm)
        above = X_WG @ np.array([0.17, 0.0, 0.0])
        bin_ = bin_boxes(scenario)[f"{arm.name}_bin"]
        inside = [*np.mean(bin_, axis=0)[:2], 0.05]
        places = [*[[0.5, 0.0, 0.03]] * 3, above, *[inside] * 5]
        made[f"{arm.name}.mode"] = made["mode"]
        made[f"{arm.name}.state_measured"] = state
        made[f"object_pose.{thing}"] = np.array(
            [pose_to_row(RigidTransform(np.array(p))) for p in places]
        )
    status = PlannerStatus(mode=Mode.DONE, attempts=2, cycles=2)
    found = clearing_outcome(scenario, made, status)
    assert found.report_is_true  # either bin is right
    assert found.metrics()["objects_in_wrong_bin"] is None
    assert (found.cleared, found.picks_delivered) == (2, 2)
    assert found.multi_object_picks == 0
    assert sum(thing.attempts for thing in found.objects.values()) == 2
