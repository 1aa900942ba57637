from drake_srg.common.log_keys import is_pose, pose_key


def test_poses_are_told_from_other_signals():
    assert pose_key("can") == "object_pose.can"
    assert is_pose(pose_key("can"))
    assert not is_pose("object_speed.can")
