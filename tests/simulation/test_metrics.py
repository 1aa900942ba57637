import dataclasses as dc
import json
import re

import numpy as np
import pytest
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_srg.recording.output import count_phrase
from drake_srg.scenario import load_scenario
from drake_srg.simulation.metrics import kinds_of, rounded
from drake_srg.theses.script import Script, ScriptStep
from drake_srg.types import Failure, Mode, PlannerStatus
from simulation.made_logs import (
    BLOB,
    DT,
    ERROR,
    GOAL,
    SCENARIO,
    SMOOTH,
    START,
    judge,
    make_log,
    moving,
    with_pose,
)


def tilted(angle):
    R = RotationMatrix(AngleAxis(angle, [np.cos(0.3), np.sin(0.3), 0.0]))
    return RigidTransform(R, GOAL)


def test_a_perfect_run():
    metrics = judge(make_log())
    assert (metrics.success, metrics.failure, metrics.attempts) == (True, None, 1)
    assert metrics.cycle_time_s == pytest.approx(2.5)
    # The model's can is 101.8 mm high within 0.1 mm.
    assert metrics.placement_error_m == pytest.approx([0, 0, 0], abs=1e-4)
    assert metrics.placement_tilt_rad == pytest.approx(0.0, abs=1e-9)
    assert metrics.localization_error_m == pytest.approx(ERROR)
    assert metrics.real_time_factor == 2.0
    assert (metrics.sim_time_s, metrics.wall_time_s) == (3.0, 1.5)


def test_a_cans_turn_about_its_axis_does_not_count():
    seen = RollPitchYaw(0.02, 0.0, 1.0).ToRotationMatrix()
    blob = dc.replace(BLOB, X_WO=RigidTransform(seen, BLOB.position))
    status = PlannerStatus(mode=Mode.DONE, attempts=1, localization=blob)
    metrics = judge(make_log(), status)
    assert metrics.localization_turn_rad == pytest.approx(0.02, abs=1e-6)


# Criteria of success.


@pytest.mark.parametrize(("off", "success"), [(4.8e-3, True), (5.2e-3, False)])
def test_the_position_counts(off, success):
    X = RigidTransform(GOAL + np.array([0.0, off, 0.0]))
    metrics = judge(with_pose(make_log(), slice(100, None), X))
    assert metrics.success == success
    assert metrics.placement_error_m[1] == pytest.approx(off)
    assert metrics.failure == (None if success else "misplaced")


@pytest.mark.parametrize("degrees", [0.01, 4.9, 5.1, 90.0, 179.0])
def test_the_tilt_counts(degrees):
    X = tilted(np.deg2rad(degrees))
    metrics = judge(with_pose(make_log(), slice(100, None), X))
    assert metrics.success == (degrees < 5.0)
    assert metrics.placement_tilt_rad == pytest.approx(np.deg2rad(degrees))


@pytest.mark.parametrize("turned", [0.0, 0.2])
def test_a_script_must_leave_a_lying_object_lying(turned):
    lying = RotationMatrix.MakeXRotation(np.pi / 2)
    log = with_pose(make_log(), slice(0, 100), RigidTransform(lying, [0.6, 0.1, 0.3]))
    end = RotationMatrix.MakeYRotation(turned) @ lying
    goal = RigidTransform(end, [*GOAL[:2], 0.3])
    scripted = dc.replace(SCENARIO, planner=Script(steps=[ScriptStep()]))
    metrics = judge(with_pose(log, slice(100, None), goal), scenario=scripted)
    # A turn about the lying can's axis is rolling, which does not count.
    assert metrics.placement_tilt_rad == pytest.approx(0.0, abs=1e-9)
    assert metrics.placement_error_m == pytest.approx([0, 0, 0], abs=1e-9)
    assert metrics.success
    upright = with_pose(log, slice(100, None), RigidTransform([*GOAL[:2], 0.3]))
    stood = judge(upright, scenario=scripted)
    assert stood.placement_tilt_rad == pytest.approx(np.pi / 2)
    assert not stood.success


@pytest.mark.parametrize("end", [0.0, np.pi])
def test_an_object_that_lay_may_stand_on_either_end(end):
    lying = RotationMatrix.MakeXRotation(np.pi / 2)
    radius = 0.0339  # of the can
    log = with_pose(
        make_log(), slice(0, 100), RigidTransform(lying, [*START[:2], radius])
    )
    stood = RigidTransform(RotationMatrix.MakeXRotation(end), GOAL)
    metrics = judge(with_pose(log, slice(100, None), stood))
    assert metrics.placement_tilt_rad == pytest.approx(0.0, abs=1e-9)
    assert metrics.success
    log = with_pose(log, slice(100, None), RigidTransform(lying, GOAL))
    assert judge(log).placement_tilt_rad == pytest.approx(np.pi / 2)


def test_after_two_cycles_the_object_must_be_back():
    scenario = dc.replace(SCENARIO, task=dc.replace(SCENARIO.task, repeat=2))
    status = PlannerStatus(mode=Mode.DONE, cycles=2, localization=BLOB)
    back = with_pose(make_log(), slice(100, None), RigidTransform(START))
    metrics = judge(back, status, scenario=scenario)
    assert metrics.success
    assert metrics.placement_error_m == pytest.approx([0, 0, 0], abs=1e-4)
    assert (metrics.cycles, metrics.cycle_time_s) == (2, pytest.approx(1.25))
    assert not judge(make_log(), status, scenario=scenario).success


def test_the_goal_can_be_above_the_table():
    place = dc.replace(SCENARIO.task.place, height=0.02)
    scenario = dc.replace(SCENARIO, task=dc.replace(SCENARIO.task, place=place))
    assert not judge(make_log(), scenario=scenario).success
    X = RigidTransform(GOAL + np.array([0.0, 0.0, 0.02]))
    raised = with_pose(make_log(), slice(100, None), X)
    assert judge(raised, scenario=scenario).success


def test_a_turn_about_the_vertical_is_no_tilt():
    X = RigidTransform(RotationMatrix.MakeZRotation(2.0), GOAL)
    metrics = judge(with_pose(make_log(), slice(100, None), X))
    assert metrics.success
    assert metrics.placement_tilt_rad == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("speed", "success"), [(0.9e-3, True), (1.1e-3, False)])
def test_the_final_speed_counts(speed, success):
    log = make_log()
    log["object_pose.soup_can"][-10:, 0] += speed * DT * np.arange(-9, 1)
    assert judge(log).success == success


@pytest.mark.parametrize(
    ("touching", "success"),
    [
        ({"support"}, True),
        (set(), False),
        ({"support", "gripper"}, False),
        ({"support", "arm"}, False),
        ({"support", "cup"}, False),
        ({"gripper"}, False),
    ],
)
def test_nothing_but_its_support_may_touch_the_object(touching, success):
    assert judge(make_log(), touching=touching).success == success


@pytest.mark.parametrize(("off", "success"), [(0.009, True), (0.011, False)])
def test_the_arm_must_be_home(off, success):
    log = make_log()
    log["arm.state_measured"][-1, 3] += off
    assert judge(log).success == success


@pytest.mark.parametrize(
    ("mode", "failure", "expected"),
    [
        (Mode.FAILED, Failure.DROPPED, "dropped"),
        (Mode.FAILED, Failure.NOT_SEEN, "not_seen"),
        (Mode.LIFT, None, "time_budget"),  # the planner never ended
    ],
)
def test_a_planner_that_does_not_report_success_has_failed(mode, failure, expected):
    status = PlannerStatus(mode=mode, failure=failure)
    metrics = judge(make_log(), status)
    assert (metrics.success, metrics.failure) == (False, expected)
    assert metrics.cycle_time_s is None
    assert metrics.localization_error_m is None


def test_a_run_without_the_object_fails():
    log = make_log()
    del log["object_pose.soup_can"]
    status = PlannerStatus(mode=Mode.FAILED, failure=Failure.NOT_SEEN)
    metrics = judge(log, status, touching=())
    assert not metrics.success
    for name in ("placement_error_m", "placement_tilt_rad", "peak_contact_force_n"):
        assert getattr(metrics, name) is None


def test_the_localisation_that_led_to_the_grasp_counts():
    status = PlannerStatus(mode=Mode.DONE, localization=BLOB, localized_at=0.3)
    log = make_log()
    log["object_pose.soup_can"][:15, 0] += 0.1  # before 0.3 s it stood elsewhere
    metrics = judge(log, status)
    assert metrics.localization_error_m == pytest.approx(ERROR)
    assert metrics.cycle_time_s == pytest.approx(2.2)


def test_the_peak_force_is_the_largest_of_all_samples():
    log = make_log()
    log["contact_force"][40] = 12.5
    assert judge(log).peak_contact_force_n == 12.5


def fallen(log, name="soup_can"):
    """Let an object of a log fall to the floor."""
    log[f"object_pose.{name}"][-20:, 2] = -0.7
    return log


def test_what_falls_is_off_the_table_and_measured_no_further(tmp_path):
    metrics = judge(fallen(make_log()), touching=())
    assert metrics.off_table == ["soup_can"]
    assert metrics.placement_error_m is metrics.placement_tilt_rad is None
    assert not metrics.success
    assert re.search(r"off the table +soup_can\n", metrics.table())
    metrics.write(tmp_path / "metrics.json")
    written = json.loads((tmp_path / "metrics.json").read_text())
    assert written["off_table"] == ["soup_can"]
    assert written["placement_error_m"] is None


def test_what_was_knocked_off_the_table_is_named():
    scenario = load_scenario(
        "kitchen",
        overrides=["objects.mug={model: package://drake_srg/sdf/025_mug.sdf}"],
    )
    log = make_log()
    log["object_pose.mug"] = log["object_pose.soup_can"].copy()
    metrics = judge(fallen(log, "mug"), scenario=scenario)
    assert metrics.off_table == ["mug"]
    assert metrics.placement_error_m is not None
    assert re.search(r"off the table +mug\n", metrics.table())


def test_what_starts_low_may_stay_there():
    log = make_log()
    log["object_pose.soup_can"][:, 2] = -0.7
    assert judge(log).off_table is None


def test_drawn_objects_are_told_by_their_kind(tmp_path):
    scenario = load_scenario("clear_table", seed=0)
    kinds = {config.kind for config in scenario.objects.values()}
    metrics = dc.replace(judge(make_log()), kinds=kinds_of(scenario))
    assert set(metrics.kinds) == set(scenario.objects)
    assert set(metrics.kinds.values()) <= kinds
    thing = {"outcome": "cleared", "attempts": 1}
    metrics = dc.replace(metrics, objects={"clutter_1": thing})
    kind = metrics.kinds["clutter_1"]
    assert re.search(rf"clutter_1 \({kind}\) +cleared, 1 attempt\n", metrics.table())
    assert judge(make_log()).kinds is None


@pytest.mark.parametrize(
    ("value", "shown"), [(-1e-6, "0.00"), (1.23456e-3, "1.23"), (-2e-3, "-2.00")]
)
def test_vectors_have_no_negative_zero(value, shown):
    metrics = dc.replace(judge(make_log()), placement_error_m=[value] * 3)
    assert f" {', '.join([shown] * 3)} mm" in metrics.table()


def test_rounding_errors_are_shown_as_zero():
    assert [rounded(x) for x in (1.55e-08, -1e-9, 0.0, 0.123456, 1234.5)] == [
        *("0", "0", "0", "0.123", "1.23e+03")
    ]
    assert [count_phrase(n, "attempt") for n in (0, 1, 2)] == [
        *("0 attempts", "1 attempt", "2 attempts")
    ]


# The file.

KEYS = """
schema_version scenario seed success failure attempts cycles cycle_time_s
time_to_placement_s grasp_lifted
planning_wall_s localization_error_m localization_turn_rad
placement_error_m placement_tilt_rad
grasp_shift_m smoothness
hold_drift_m_per_s peak_contact_force_n others_moved_m
sim_time_s wall_time_s real_time_factor artifacts
"""


def test_the_file_has_the_keys_of_the_schema(tmp_path):
    path = tmp_path / "metrics.json"
    judge(moving(SMOOTH)).write(path)
    metrics = json.loads(path.read_text())
    assert set(metrics) == set(KEYS.split())
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_that_cannot_be_written_leaves_the_old_one(tmp_path):
    path = tmp_path / "metrics.json"
    path.write_text("old")
    metrics = judge(make_log())
    metrics.cycle_time_s = object()
    with pytest.raises(TypeError, match="JSON"):
        metrics.write(path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
