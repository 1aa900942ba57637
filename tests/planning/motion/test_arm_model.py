"""Bounds on how far the points of an arm move."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.planning.motion.arm_model import ArmChain
from drake_srg.scenario import load_scenario
from drake_srg.station.planners import own_scene


@pytest.fixture(scope="module", params=["kitchen", "assistive_arm"])
def scene(request):
    return own_scene(load_scenario(request.param))


def corners(scene, q):
    """Return the corners of boxes around all moving geometry, in world, (M, 3) [m]."""
    scene.X_WG(q)
    inspector = scene._checker.model().scene_graph().model_inspector()
    signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1)
    points = []
    for model in ("arm", "gripper"):
        instance = scene.plant.GetModelInstanceByName(model)
        for body in map(scene.plant.get_body, scene.plant.GetBodyIndices(instance)):
            X_WB = body.EvalPoseInWorld(scene.context)
            for geometry in scene.plant.GetCollisionGeometriesForBody(body):
                box = inspector.GetObbInGeometryFrame(geometry)
                X_BG = inspector.GetPoseInFrame(geometry) @ box.pose()
                points.append(X_WB @ X_BG @ (box.half_width()[:, None] * signs))
    return np.concatenate(points, axis=1).T


units = st.lists(st.floats(-1.0, 1.0), min_size=7, max_size=7).map(np.array)


@settings(max_examples=25)
@given(units, units, st.floats(0.01, 0.3))
def test_nothing_moves_further_than_the_bound(scene, unit, turn, size):
    n = scene.num_joints
    q = scene.lower + 0.5 * (unit[:n] + 1.0) * (scene.upper - scene.lower)
    dq = size * turn[:n]
    [bound] = scene.travel(np.array([q, q + dq]))
    placed = [corners(scene, q + share * dq) for share in (0.0, 0.25, 0.5, 1.0)]
    for before, after, share in ((0, 1, 0.25), (1, 2, 0.25), (2, 3, 0.5), (0, 3, 1.0)):
        moved = np.linalg.norm(placed[after] - placed[before], axis=1).max()
        assert moved <= share * bound + 1e-9


def test_a_hand_on_a_line_moves_far_less_than_each_joint_could_move_it(iiwa, home):
    up = iiwa.X_WG(home).translation()[2]
    dq = 0.02 * np.array([0.0, 1.0, 0.0, 2.0, 0.0, 1.0, 0.0])  # they partly cancel
    path = np.array([home, home + dq])
    assert 0.0 < iiwa.X_WG(path[1]).translation()[2] - up < 0.02
    assert iiwa.travel(path)[0] < 0.5 * iiwa.levers @ dq


def test_a_joint_that_slides_moves_all_that_follows():
    x, y = np.eye(3)[:2]
    chain = ArmChain(
        axes=np.array([x, y]),
        points=np.array([np.zeros(3), 0.5 * x, x]),
        turns=np.array([0.0, 1.0]),
        reach=0.1,
    )
    slide, turn = np.array([0.2, 0.0]), np.array([0.0, np.pi / 2])
    path = np.cumsum([slide, slide, turn, slide + turn], axis=0)
    begin, end = chain.speeds(path)
    np.testing.assert_allclose(begin[:2], [0.2, 0.25 * np.pi + 0.05 * np.pi])
    np.testing.assert_allclose(end[:2], begin[:2])
    # The hand hangs. It swings along x, as the slide moves, and later across it.
    swing, reach = 0.25 * np.pi, 0.05 * np.pi
    np.testing.assert_allclose(begin[2], max(0.2, abs(0.2 - swing)) + reach)
    np.testing.assert_allclose(end[2], np.hypot(0.2, swing) + reach)


def test_the_arm_s_joints_are_in_order_with_their_limits(iiwa):
    assert iiwa.joint_names == [f"joint_{i}" for i in range(1, 8)]
    assert iiwa.lower.shape == iiwa.upper.shape == (7,)
    assert iiwa.upper[3] == pytest.approx(2.0944, abs=1e-4)


def test_the_hand_of_the_stretched_arm_is_as_far_as_its_links_are_long(iiwa):
    # 0.36 + 0.42 + 0.4 + 0.081 + 0.045 of the data sheet's and the flange's heights.
    X_WG = iiwa.X_WG(np.zeros(7))
    np.testing.assert_allclose(X_WG.translation(), [0.0, 0.0, 1.306], atol=1e-6)
    np.testing.assert_allclose(X_WG.rotation().matrix()[:, 0], [0, 0, 1], atol=1e-6)


def test_a_joint_without_limits_gets_two_turns(pendulum):
    np.testing.assert_allclose(pendulum.lower, [-3.0, -2 * np.pi])
    np.testing.assert_allclose(pendulum.upper, [3.0, 2 * np.pi])


def test_an_arm_of_seven_joints_reaches_any_pose_and_one_of_two_does_not(
    iiwa, pendulum
):
    assert (iiwa.num_joints, iiwa.reaches_any_pose) == (7, True)
    assert (pendulum.num_joints, pendulum.reaches_any_pose) == (2, False)


def test_only_the_arm_moves_in_positions(iiwa, home):
    still, moved = iiwa.positions(np.zeros(7)), iiwa.positions(home)
    np.testing.assert_array_equal(moved[iiwa.arm_indices], home)
    others = np.delete(np.arange(len(moved)), iiwa.arm_indices)
    np.testing.assert_array_equal(moved[others], still[others])


def test_fingers_are_set_by_name_and_the_others_open(iiwa):
    try:
        iiwa.SetFingers({"left_tip_joint": 0.2, "right_base_joint": 0.7})
        angles = dict(zip(iiwa.finger_names, iiwa.fingers, strict=True))
        expected = {"left_tip_joint": 0.2, "right_base_joint": 0.7}
        assert angles == {**dict.fromkeys(iiwa.finger_names, 0.0), **expected}
    finally:
        iiwa.SetFingers({})
    np.testing.assert_array_equal(iiwa.fingers, np.zeros(4))


def test_an_unknown_finger_is_refused_with_the_known_ones(iiwa):
    with pytest.raises(ValueError, match=r"no joints \['thumb'\] .*left_base_joint"):
        iiwa.SetFingers({"thumb": 0.1})


def test_no_joint_moves_the_hand_further_than_its_lever(iiwa, home):
    p_WG = iiwa.X_WG(home).translation()
    for i, lever in enumerate(iiwa.levers):
        turned = home + 1e-3 * np.eye(7)[i]
        moved = np.linalg.norm(iiwa.X_WG(turned).translation() - p_WG)
        assert moved <= 1e-3 * lever
