import dataclasses as dc
import json

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant

from drake_srg.planning.script.scripted import ScriptStep
from drake_srg.scenario import load_scenario
from drake_srg.simulation.metrics import MODES, RunTimes, calc_metrics, pose_to_row
from drake_srg.station.plant import AddDirectives
from drake_srg.types import Blob, Failure, Mode, PlannerStatus

SCENARIO = load_scenario("kitchen", seed=0)
HOME = np.array(SCENARIO.arm.home)
GOAL = np.array([0.55, -0.42, 0.05090])
START = np.array([0.6, 0.1, GOAL[2]])
DT = 0.02
# A run of 3 s: when each mode begins [s].
BEGINS = {
    Mode.IDLE: 0.0,
    Mode.PRE_GRASP: 0.1,
    Mode.CLOSE: 0.5,
    Mode.LIFT: 1.0,
    Mode.TRANSFER: 1.5,
    Mode.RELEASE: 2.0,
    Mode.HOME: 2.2,
    Mode.DONE: 2.5,
}
ERROR = np.array([1e-4, -2e-4, 3e-4])
BLOB = Blob("soup_can", "ceiling", (1.0, 2.0), START + ERROR, np.eye(3)[2], 1.0)


def make_log(**changes):
    """A log of a perfect run: the can jumps to its goal, the arm stays at home."""
    time = DT * np.arange(151)
    mode = np.zeros(151)
    for name, begin in BEGINS.items():
        mode[time >= begin - 1e-9] = MODES.index(name)
    carried = (time >= BEGINS[Mode.TRANSFER] - 1e-9)[:, None]
    position = np.where(carried, GOAL, START)
    log = {
        "time": time,
        "mode": mode,
        "object_pose.soup_can": np.hstack(
            [position, np.tile([1.0, 0, 0, 0], (151, 1))]
        ),
        "arm.state_measured": np.hstack([np.tile(HOME, (151, 1)), np.zeros((151, 7))]),
        "contact_force": np.zeros(151),
    }
    return log | changes


def judge(log, status=None, touching=("support",), scenario=SCENARIO):
    status = status or PlannerStatus(
        mode=Mode.DONE, attempts=1, localization=BLOB, localized_at=0.0
    )
    times = RunTimes(simulated=3.0, wall=1.5)
    return calc_metrics(scenario, "kitchen", log, status, set(touching), times, {})


def with_pose(log, rows, X):
    log["object_pose.soup_can"][rows] = pose_to_row(X)
    return log


def tilted(angle):
    R = RotationMatrix(AngleAxis(angle, [np.cos(0.3), np.sin(0.3), 0.0]))
    return RigidTransform(R, GOAL)


def test_a_perfect_run():
    metrics = judge(make_log())
    assert (metrics.success, metrics.failure, metrics.attempts) == (True, None, 1)
    assert metrics.cycle_time_s == pytest.approx(2.5)
    # The model's can is 101.8 mm high up to a tenth of a millimetre.
    assert metrics.placement_error_m == pytest.approx([0, 0, 0], abs=1e-4)
    assert metrics.placement_tilt_rad == pytest.approx(0.0, abs=1e-9)
    assert metrics.localization_error_m == pytest.approx(ERROR)
    assert metrics.real_time_factor == 2.0
    assert (metrics.sim_time_s, metrics.wall_time_s) == (3.0, 1.5)


# The criteria of success, one by one.


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
def test_what_lay_at_first_shall_lie_again(turned):
    lying = RotationMatrix.MakeXRotation(np.pi / 2)
    log = with_pose(make_log(), slice(0, 100), RigidTransform(lying, [0.6, 0.1, 0.3]))
    end = RotationMatrix.MakeYRotation(turned) @ lying
    goal = RigidTransform(end, [*GOAL[:2], 0.3])
    scripted = dc.replace(SCENARIO, script=[ScriptStep()])
    metrics = judge(with_pose(log, slice(100, None), goal), scenario=scripted)
    # Turned about the axis of the lying can, it rolled; about the other, it tilts.
    assert metrics.placement_tilt_rad == pytest.approx(0.0, abs=1e-9)
    assert metrics.placement_error_m == pytest.approx([0, 0, 0], abs=1e-9)
    assert metrics.success
    upright = with_pose(log, slice(100, None), RigidTransform([*GOAL[:2], 0.3]))
    stood = judge(upright, scenario=scripted)
    assert stood.placement_tilt_rad == pytest.approx(np.pi / 2)
    assert not stood.success


@pytest.mark.parametrize("end", [0.0, np.pi])
def test_what_lay_at_first_shall_stand_on_either_end(end):
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


def test_what_went_there_and_back_shall_be_where_it_was():
    scenario = dc.replace(SCENARIO, task=dc.replace(SCENARIO.task, repeat=2))
    status = PlannerStatus(mode=Mode.DONE, cycles=2, localization=BLOB)
    back = with_pose(make_log(), slice(100, None), RigidTransform(START))
    metrics = judge(back, status, scenario=scenario)
    assert metrics.success
    assert metrics.placement_error_m == pytest.approx([0, 0, 0], abs=1e-4)
    assert (metrics.cycles, metrics.cycle_time_s) == (2, pytest.approx(1.25))
    assert not judge(make_log(), status, scenario=scenario).success


def test_the_goal_may_be_higher_than_the_table():
    place = dc.replace(SCENARIO.task.place, height=0.02)
    scenario = dc.replace(SCENARIO, task=dc.replace(SCENARIO.task, place=place))
    assert not judge(make_log(), scenario=scenario).success
    X = RigidTransform(GOAL + np.array([0.0, 0.0, 0.02]))
    raised = with_pose(make_log(), slice(100, None), X)
    assert judge(raised, scenario=scenario).success


def test_turning_about_the_vertical_is_no_tilt():
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
def test_nothing_but_its_support_may_touch_it(touching, success):
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
        (Mode.LIFT, None, "time_budget"),  # it never ended
    ],
)
def test_the_planner_must_say_so_itself(mode, failure, expected):
    status = PlannerStatus(mode=mode, failure=failure)
    metrics = judge(make_log(), status)
    assert (metrics.success, metrics.failure) == (False, expected)
    assert metrics.cycle_time_s is None
    assert metrics.localization_error_m is None


def test_without_the_object_there_is_no_success():
    log = make_log()
    del log["object_pose.soup_can"]
    status = PlannerStatus(mode=Mode.FAILED, failure=Failure.NOT_SEEN)
    metrics = judge(log, status, touching=())
    assert not metrics.success
    for name in ("placement_error_m", "placement_tilt_rad", "peak_contact_force_n"):
        assert getattr(metrics, name) is None


# The figures.


def test_the_error_is_that_of_the_localisation_that_led_to_the_grasp():
    status = PlannerStatus(mode=Mode.DONE, localization=BLOB, localized_at=0.3)
    log = make_log()
    log["object_pose.soup_can"][:15, 0] += 0.1  # before 0.3 s it stood elsewhere
    metrics = judge(log, status)
    assert metrics.localization_error_m == pytest.approx(ERROR)
    assert metrics.cycle_time_s == pytest.approx(2.2)


def test_the_shift_is_what_closing_moves():
    log = make_log()
    closing = (log["time"] > 0.6) & (log["time"] < BEGINS[Mode.TRANSFER] - 1e-9)
    log["object_pose.soup_can"][closing, :2] += [3e-3, 4e-3]
    assert judge(log).grasp_shift_m == pytest.approx(5e-3)


def test_the_last_attempt_is_the_one_that_counts():
    log = make_log()
    log["mode"][8:12] = MODES.index(Mode.CLOSE)  # an earlier one, where it moves far
    log["object_pose.soup_can"][:10, 0] += 0.5
    assert judge(log).grasp_shift_m == pytest.approx(0.0)


def test_the_peak_force_is_the_largest():
    log = make_log()
    log["contact_force"][40] = 12.5
    assert judge(log).peak_contact_force_n == 12.5


def test_other_objects_count_from_where_they_stood_at_first():
    assert judge(make_log()).others_moved_m is None  # there are none
    log = make_log()
    for name, shift in (("near", 3e-3), ("far", 4e-3)):
        poses = np.tile(pose_to_row(RigidTransform([0.3, 0.2, 0.1])), (151, 1))
        poses[70:80, :2] += shift  # and back again
        log[f"object_pose.{name}"] = poses
    assert judge(log).others_moved_m == pytest.approx(4e-3 * np.sqrt(2.0))


def test_the_drift_is_measured_in_the_hand():
    """The can slides in the hand at 2 mm/s while the hand is elsewhere and moves."""
    plant = MultibodyPlant(0.0)
    AddDirectives(plant, SCENARIO)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    arm = plant.GetModelInstanceByName("arm")
    palm = plant.GetFrameByName("palm")
    log = make_log()
    for i, t in enumerate(log["time"]):
        q = HOME + 0.1 * np.sin(3.0 * t)
        plant.SetPositions(context, arm, q)
        log["arm.state_measured"][i, :7] = q
        p_GO = [0.15, 0.01, 2e-3 * t]
        X_WO = RigidTransform(palm.CalcPoseInWorld(context) @ np.array(p_GO))
        log["object_pose.soup_can"][i] = pose_to_row(X_WO)
    assert judge(log).hold_drift_m_per_s == pytest.approx(2e-3, rel=1e-6)


def test_without_a_lift_there_is_no_drift():
    log = make_log()
    log["mode"][log["mode"] == MODES.index(Mode.TRANSFER)] = MODES.index(Mode.LIFT)
    assert judge(log).hold_drift_m_per_s is None


# A speed profile over 0 .. 1 that begins and ends without a jerk.
SMOOTH = 140 * Polynomial([0, 1]) ** 3 * Polynomial([1, -1]) ** 3


def moving(profile, amplitude=1.0):
    """A log in which joint 2 has the speed profile, from first motion to last."""
    log = make_log()
    s = np.clip((log["time"] - 0.1) / 2.38, 0.0, 1.0)
    log["arm.state_measured"][:, 8] = amplitude * profile(s)
    return log


def test_smoothness_of_a_known_profile():
    # -ln(T³ / peak² integral of v''²) with the integral exact; the time T cancels.
    integral = (SMOOTH.deriv(2) ** 2).integ()
    expected = -np.log((integral(1.0) - integral(0.0)) / SMOOTH(0.5) ** 2)
    # Differences of 119 samples are good to a percent of the integral.
    assert judge(moving(SMOOTH)).smoothness == pytest.approx(expected, abs=0.01)


def test_smoothness_has_no_unit():
    reference = judge(moving(SMOOTH)).smoothness
    assert judge(moving(SMOOTH, 7.0)).smoothness == pytest.approx(reference)


def test_a_trembling_motion_is_less_smooth():
    def trembling(s):
        return SMOOTH(s) + 0.05 * np.sin(60.0 * s)

    smooth = judge(moving(SMOOTH)).smoothness
    assert judge(moving(trembling)).smoothness < smooth - 1.0


def test_an_arm_that_rests_has_no_smoothness():
    assert judge(make_log()).smoothness is None


# The file.

KEYS = """
schema_version scenario seed success failure attempts cycles cycle_time_s
planning_wall_s localization_error_m placement_error_m placement_tilt_rad
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
