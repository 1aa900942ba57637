import numpy as np
import pytest

from drake_srg.recording.timeline import Labels, run_timeline, timeline_panels
from drake_srg.types import Mode

TIME = np.array([0.0, 0.02, 0.04])
LOG = {
    "time": TIME,
    "mode": np.array([0.0, 1.0, 1.0]),
    "arm.state_measured": np.arange(12.0).reshape(3, 4),
    "gripper.state_measured": np.arange(12.0).reshape(3, 4),
    "gripper.proximity": np.full((3, 1), np.inf),
    "object_pose.can": np.tile([0.1, 0.2, 0.3, 1, 0, 0, 0], (3, 1)),
}
LABELS = Labels("title", "can", ("left_base_joint", "right_joint"), ("left_tip",))


def test_columns_get_their_names():
    timeline = run_timeline(LOG, LABELS)
    assert timeline.title == "title"
    assert timeline.mode == [list(Mode)[i].value for i in (0, 1, 1)]
    assert timeline.gripper_joints == ["left base", "right"]
    assert timeline.sensors == ["left tip"]
    np.testing.assert_array_equal(timeline.arm_velocity[0], [2, 3])
    np.testing.assert_array_equal(timeline.gripper_position[0], [0, 1])
    np.testing.assert_array_equal(timeline.object_height, [0.3] * 3)


def test_what_a_cell_does_not_measure_has_no_panel():
    names = ("time", "mode", "arm.state_measured")
    timeline = run_timeline({name: LOG[name] for name in names}, Labels("title"))
    (panel,) = timeline_panels(timeline)
    assert panel[0] == "arm velocity\n[deg/s]"


@pytest.mark.parametrize(
    ("slides", "units"), [(False, ["[deg/s]", "[N m]"]), (True, ["[mm/s]", "[N]"])]
)
def test_the_arms_units_are_those_of_its_joints(slides, units):
    names = ("time", "mode", "arm.state_measured")
    log = {name: LOG[name] for name in names} | {"arm.torque_measured": np.ones((3, 2))}
    panels = timeline_panels(run_timeline(log, Labels("title", arm_slides=slides)))
    assert [label.split("\n")[1] for label, _, _ in panels] == units
