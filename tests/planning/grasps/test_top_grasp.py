import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.planning.grasps.srg_fingers import SrgFingers
from drake_srg.planning.grasps.top_grasp import GraspPlan, Refusal, TopGrasp, palm_pose
from drake_srg.types import Failure


def grasp(x=0.0, y=0.0, yaw=0.0):
    return TopGrasp(
        X_WG=palm_pose(np.array([x, y, 0.25]), yaw),
        fingers=SrgFingers(),
        half_gap=0.04,
        width=0.05,
        p_WC=np.array([x, y, 0.03]),
        height=0.06,
        score=1.0,
    )


@given(yaw=st.floats(-3.0, 3.0))
def test_the_hand_points_down_and_closes_along_its_yaw(yaw):
    one = grasp(yaw=yaw)
    R_WG = one.X_WG.rotation().matrix()
    np.testing.assert_allclose(R_WG[:, 0], [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(R_WG[:, 1], [np.cos(yaw), np.sin(yaw), 0], atol=1e-12)
    np.testing.assert_allclose(one.yaw, yaw, atol=1e-9)


@given(yaw=st.floats(-3.0, 3.0))
def test_a_half_turn_is_the_same_grasp(yaw):
    one = grasp(0.1, 0.2, yaw)
    other = one.half_turn()
    assert one.like(other, 1e-9, 1e-6)
    np.testing.assert_allclose(
        other.X_WG.translation(), one.X_WG.translation(), atol=1e-12
    )
    y_W = [g.X_WG.rotation().matrix()[:, 1] for g in (one, other)]
    np.testing.assert_allclose(y_W[0], -y_W[1], atol=1e-12)


def test_likeness():
    assert grasp().like(grasp(x=0.01, yaw=0.1), 0.011, 0.11)
    assert not grasp().like(grasp(x=0.012), 0.011, 0.11)
    assert not grasp().like(grasp(yaw=0.12), 0.011, 0.11)
    assert grasp(yaw=1.55).like(grasp(yaw=-1.55), 0.01, 0.05)


def test_commands_and_target():
    one = grasp()
    assert 0.0 < one.closure_open < one.closure_closed < 1.0
    assert one.fingers_open.keys() == one.fingers_closed.keys()
    assert one.tellable
    assert one.target().distance(one.X_WG) < 1e-12
    assert not one.holds(np.array([1.76, 1.76, 0.0, 0.0]), np.zeros(4))
    assert one.holds(np.array([1.2, 1.2, 0.0, 0.0]), np.zeros(4))


def test_reasons_are_found_when_they_are_asked_for():
    calls = []

    def explain():
        calls.append(1)
        return (Refusal(np.zeros(3), (0.2, 0.2), Failure.TOO_WIDE),)

    plan = GraspPlan(things=1, explain=explain)
    assert calls == []
    assert plan.refused[0].failure is Failure.TOO_WIDE
    assert plan.refused[0].size == (0.2, 0.2)
    assert calls == [1]
