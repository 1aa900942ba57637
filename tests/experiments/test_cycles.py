import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.common.log_format import MODES, pose_to_row
from drake_srg.experiments.cycles import make_cycle
from drake_srg.scenario import load_scenario
from drake_srg.simulation.measures import hand_poses
from drake_srg.types import Mode
from experiments.made_cycles import metrics

TIP = np.array([0.095, 0.0, 0.0])
HELD = np.array([0.094, 0.001, 0.0])
X, Y, Z = 1e-3 * np.eye(3)


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("assistive_arm")


def make_log(scenario, rows):
    """Return a log of modes and poses (p_GO, turn about x) in a hand at home."""
    arm = np.zeros((len(rows), 10))
    arm[:, :5] = scenario.arm.home
    poses = [
        X_WG @ RigidTransform(RotationMatrix.MakeXRotation(turn), p_GO)
        for X_WG, (_, p_GO, turn) in zip(hand_poses(scenario, arm), rows, strict=True)
    ]
    return {
        "mode": np.array([float(MODES.index(mode)) for mode, _, _ in rows]),
        "arm.state_measured": arm,
        "object_pose.cylinder": np.array([pose_to_row(X) for X in poses]),
    }


def test_motion_in_the_hand_counts_from_the_grip_to_above_the_goal(scenario):
    log = make_log(
        scenario,
        [
            (Mode.IDLE, 9 * TIP, 1.0),
            (Mode.CLOSE, TIP, 0.0),
            (Mode.CLOSE, 0.5 * (TIP + HELD), 0.0),
            (Mode.VERIFY, 0.5 * (TIP + HELD), 0.0),
            (Mode.VERIFY, HELD, 0.1),
            (Mode.LIFT, HELD + X, 0.1),
            (Mode.TRANSFER, HELD + 2 * Y, 0.13),
            (Mode.TRANSFER, HELD, 0.1),
            (Mode.PLACE, HELD + 9 * Z, 0.0),
            (Mode.DONE, 9 * TIP, 1.0),
        ],
    )
    cycle = make_cycle(scenario, metrics(placement_error_m=[0.0, 0.0, 1e-3]), log)
    np.testing.assert_allclose(cycle.p_GO_open, TIP, atol=1e-12)
    np.testing.assert_allclose(cycle.p_GO_held, HELD, atol=1e-12)
    assert cycle.slip == pytest.approx(0.002)
    assert cycle.turn == pytest.approx(0.03)
    # At home the hand is level: its z axis is the world's.
    np.testing.assert_allclose(cycle.error_G, [0.0, 0.0, 1e-3], atol=2e-5)


def test_the_last_attempt_counts(scenario):
    first = [
        (Mode.CLOSE, 3 * TIP, 0.0),
        (Mode.VERIFY, 3 * TIP, 0.0),
        (Mode.LIFT, 9 * TIP, 0.0),
        (Mode.RELEASE, 9 * TIP, 0.0),
    ]
    second = [
        (Mode.CLOSE, TIP, 0.0),
        (Mode.VERIFY, HELD, 0.0),
        (Mode.LIFT, HELD, 0.0),
    ]
    cycle = make_cycle(scenario, metrics(), make_log(scenario, [*first, *second]))
    np.testing.assert_allclose(cycle.p_GO_open, TIP, atol=1e-12)
    assert cycle.slip == pytest.approx(0.0, abs=1e-12)
    assert cycle.error_G is None


def test_a_cycle_without_a_grasp_has_no_motion_in_the_hand(scenario):
    log = make_log(scenario, [(Mode.IDLE, TIP, 0.0), (Mode.FAILED, TIP, 0.0)])
    cycle = make_cycle(scenario, metrics(success=False), log)
    parts = (cycle.p_GO_open, cycle.p_GO_held, cycle.slip, cycle.turn, cycle.error_G)
    assert parts == (None,) * 5
