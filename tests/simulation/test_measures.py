import dataclasses as dc

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant

from drake_srg.common.log_format import MODES, pose_to_row
from drake_srg.common.safety_states import SafetyState, StopReason, state_indices
from drake_srg.scenario import load_scenario
from drake_srg.simulation import measures
from drake_srg.simulation.measures import hand_poses
from drake_srg.simulation.metrics import is_placed
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.station.plant import AddDirectives
from drake_srg.types import Mode, PlannerStatus
from simulation.made_logs import (
    BEGINS,
    BLOB,
    HOME,
    SCENARIO,
    SMOOTH,
    judge,
    make_log,
    moving,
)


@pytest.mark.slow
@pytest.mark.parametrize("rpy", [(0.0, 90.0, 0.0), (0.0, 0.0, 30.0)])
def test_logged_arm_states_give_the_poses_of_the_palm(rpy):
    scenario = bench_scenario(gripper_rpy=rpy, home=[0.1, -0.2, 0.5])
    palms = []
    with Rig(scenario, log_period=0.05) as rig:
        palms.append(rig.X_WG())
        for _ in range(3):
            rig.move(rig.commanded("arm.position_commanded") + 0.01, 0.05)
            palms.append(rig.X_WG())
        states = rig.log()["arm.state_measured"]
    assert not palms[0].IsNearlyEqualTo(palms[-1], 1e-3)
    for X_WG, expected in zip(hand_poses(scenario, states), palms, strict=True):
        assert X_WG.IsNearlyEqualTo(expected, 1e-9)


def test_no_states_give_no_poses():
    assert hand_poses(bench_scenario(), np.zeros((0, 6))) == []


def test_the_grasp_shift_is_the_motion_while_closing():
    log = make_log()
    closing = (log["time"] > 0.6) & (log["time"] < BEGINS[Mode.TRANSFER] - 1e-9)
    log["object_pose.soup_can"][closing, :2] += [3e-3, 4e-3]
    assert judge(log).grasp_shift_m == pytest.approx(5e-3)


def test_only_the_last_grasp_counts():
    log = make_log()
    log["mode"][8:12] = MODES.index(Mode.CLOSE)  # an earlier grasp
    log["object_pose.soup_can"][:10, 0] += 0.5
    assert judge(log).grasp_shift_m == pytest.approx(0.0)


def test_other_objects_move_from_their_first_position():
    assert judge(make_log()).others_moved_m is None  # there are none
    log = make_log()
    for name, shift in (("near", 3e-3), ("far", 4e-3)):
        poses = np.tile(pose_to_row(RigidTransform([0.3, 0.2, 0.1])), (151, 1))
        poses[70:80, :2] += shift  # and back again
        log[f"object_pose.{name}"] = poses
    assert judge(log).others_moved_m == pytest.approx(4e-3 * np.sqrt(2.0))


def test_the_drift_is_relative_to_the_hand():
    """The can slides in the moving hand at 2 mm/s."""
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


def test_an_object_that_was_not_carried_has_no_drift():
    log = make_log()
    log["mode"][log["mode"] == MODES.index(Mode.TRANSFER)] = MODES.index(Mode.LIFT)
    assert judge(log).hold_drift_m_per_s is None


def test_the_smoothness_of_a_known_profile():
    # -ln(T³ / peak² integral of v''²) with the integral exact; the time T cancels.
    integral = (SMOOTH.deriv(2) ** 2).integ()
    expected = -np.log((integral(1.0) - integral(0.0)) / SMOOTH(0.5) ** 2)
    # Differences of 119 samples are good to a percent of the integral.
    assert judge(moving(SMOOTH)).smoothness == pytest.approx(expected, abs=0.01)


def test_smoothness_is_dimensionless():
    reference = judge(moving(SMOOTH)).smoothness
    assert judge(moving(SMOOTH, 7.0)).smoothness == pytest.approx(reference)


def test_a_trembling_motion_is_less_smooth():
    def trembling(s):
        return SMOOTH(s) + 0.05 * np.sin(60.0 * s)

    smooth = judge(moving(SMOOTH)).smoothness
    assert judge(moving(trembling)).smoothness < smooth - 1.0


def test_an_arm_at_rest_has_no_smoothness():
    assert judge(make_log()).smoothness is None


def test_an_arm_whose_measurements_stand_still_has_no_smoothness():
    log = make_log()
    log["arm.state_measured"][:, 8] = 0.5
    assert judge(log).smoothness is None


def test_the_true_state_of_the_arm_comes_first():
    log = {"arm.state_measured": np.zeros((3, 2)), "arm.state_cheat": np.ones((3, 2))}
    assert measures.arm_states(log) is log["arm.state_cheat"]
    del log["arm.state_cheat"]
    assert measures.arm_states(log) is log["arm.state_measured"]
    assert measures.arm_states({}) is None


def test_a_run_too_short_for_a_speed_does_not_count_as_resting():
    log = make_log()
    poses = log["object_pose.soup_can"]
    assert measures.final_speed(log["time"], poses) == 0.0
    assert measures.final_speed(log["time"][:1], poses[:1]) == np.inf


@pytest.mark.parametrize(("rise", "lifted"), [(0.014, False), (0.016, True)])
def test_a_grasp_counts_once_the_object_is_off_its_support(rise, lifted):
    log = make_log()
    log["object_pose.soup_can"][60:75, 2] += rise
    assert judge(log).grasp_lifted is lifted


def test_without_a_lift_nothing_was_grasped():
    log = make_log()
    log["mode"][:] = MODES.index(Mode.IDLE)
    assert judge(log, PlannerStatus(mode=Mode.FAILED)).grasp_lifted is False


def test_the_time_to_placement_ends_where_the_hand_opens_at_the_goal():
    log = make_log()
    log["mode"][90:100] = MODES.index(Mode.PLACE)  # opens at 2.0 s
    status = PlannerStatus(
        mode=Mode.DONE, cycles=1, localization=BLOB, localized_at=0.25
    )
    assert judge(log, status).time_to_placement_s == pytest.approx(1.75)
    for other in (make_log(), None):  # never placed; placed twice
        twice = dc.replace(status, cycles=2 if other is None else 1)
        assert judge(other or log, twice).time_to_placement_s is None


def test_each_safety_stop_is_told_once():
    running = state_indices(SafetyState.RUNNING, StopReason.NONE)
    braking = state_indices(SafetyState.BRAKING, StopReason.STALE)
    stopped = state_indices(SafetyState.PROTECTIVE_STOP, StopReason.STALE)
    log = {
        "time": np.arange(6.0),
        "safety.state": np.array(
            [running, braking, stopped, running, running, braking]
        ),
    }
    assert measures.safety_stops(log) == [
        {"time_s": 1.0, "reason": "stale"},
        {"time_s": 5.0, "reason": "stale"},
    ]
    assert measures.safety_stops({"time": np.arange(6.0)}) is None


def hole_and_peg():
    """Return a scenario with a hole, and the pose of its seated peg, X_WO [m]."""
    scenario = load_scenario("insert_varied", seed=1, overrides=["chosen.part=keyed"])
    welds = [d.add_weld for d in scenario.directives if d.add_weld is not None]
    (weld,) = [weld for weld in welds if weld.child == "hole::block"]
    X_WH = weld.X_PC.GetDeterministicValue()
    return scenario, X_WH @ RigidTransform([0.0, 0.0, 0.05 - 0.02])


def test_the_end_of_a_peg_is_compared_with_its_place_in_the_true_hole():
    scenario, X_WO = hole_and_peg()
    for p in ([0.0, 0.0, 0.0], [0.0, 0.0, 0.005], [0.001, -0.002, 0.03]):
        error = measures.end_error(scenario, X_WO @ RigidTransform(p))
        assert error == pytest.approx(p, abs=1e-9)
    assert measures.end_error(SCENARIO, RigidTransform()) is None


def test_a_peg_that_lies_beside_its_hole_is_not_inserted():
    """Its end can be as high as the floor of the hole."""
    scenario, X_WO = hole_and_peg()
    R = RotationMatrix.MakeXRotation(0.5 * np.pi)
    lying = RigidTransform(R, [-0.026, 0.036, -0.05] + R @ [0.0, 0.0, 0.05])
    for X, inserted in ((X_WO, True), (X_WO @ lying, False)):
        assert measures.end_error(scenario, X)[2] == pytest.approx(0.0, abs=1e-9)
        poses = np.array(2 * [pose_to_row(X)])
        found = is_placed(scenario, X_WO, np.array([0.0, 0.1]), poses, ["support"])
        assert found is inserted


@pytest.mark.parametrize(("above", "inserted"), [(4e-4, True), (6e-4, False)])
def test_a_peg_that_stops_above_its_seat_is_not_inserted(above, inserted):
    scenario, X_WO = hole_and_peg()
    poses = np.array(2 * [pose_to_row(X_WO @ RigidTransform([0.0, 0.0, above]))])
    found = is_placed(scenario, X_WO, np.array([0.0, 0.1]), poses, ["support"])
    assert found is inserted


def test_the_force_on_the_hole_is_the_peak_so_far():
    assert measures.hole_force({"hole_force_cheat": np.array([[1.0], [7.0]])}) == 7.0
    assert measures.hole_force({}) is None
