import numpy as np
import pytest


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
