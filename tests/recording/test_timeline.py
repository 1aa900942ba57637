import cv2
import numpy as np
import pytest

from drake_srg.recording.timeline import Timeline, draw_timeline

TIME = np.linspace(0.0, 4.0, 81)
FULL = {
    "mode": ["grasp"] * 40 + ["close"] * 41,
    "gripper_position": np.outer(TIME, [0.1, 0.2]),
    "gripper_joints": ["left", "right"],
    "closure": TIME / 4,
    "proximity": np.where(TIME[:, None] > 1, 0.02, np.inf),
    "sensors": ["left"],
    "grip_force": TIME**2,
    "arm_velocity": np.sin(np.outer(TIME, np.arange(7))),
    "arm_torque": np.cos(np.outer(TIME, np.arange(7))),
    "object_height": 0.05 + 0.01 * TIME,
}


def draw(path, **fields):
    return cv2.imread(str(draw_timeline(Timeline(TIME, **fields), path)))


@pytest.mark.slow
def test_a_full_timeline_has_seven_panels(tmp_path):
    full = draw(tmp_path / "full.png", **FULL, title="kitchen")
    one = draw(tmp_path / "one.png", closure=FULL["closure"])
    assert full.shape[1] == one.shape[1]
    assert full.shape[0] > 3 * one.shape[0]


@pytest.mark.slow
@pytest.mark.parametrize("field", ["mode", "closure", "arm_velocity", "proximity"])
def test_every_series_is_drawn(tmp_path, field):
    full = draw(tmp_path / "full.png", **FULL)
    changed = {**FULL, field: np.roll(FULL[field], 17, axis=0)}
    if field == "mode":
        changed["mode"] = changed["mode"].tolist()
    other = draw(tmp_path / "other.png", **changed)
    assert full.shape != other.shape or not np.array_equal(full, other)


@pytest.mark.slow
def test_an_arm_of_prismatic_joints_has_another_unit(tmp_path):
    turns, slides = (
        draw(tmp_path / f"{i}.png", **FULL, arm_slides=bool(i)) for i in (0, 1)
    )
    assert turns.shape != slides.shape or not np.array_equal(turns, slides)


@pytest.mark.slow
def test_equal_values_give_equal_bytes(tmp_path):
    for name in "ab":
        draw(tmp_path / f"{name}.png", **FULL)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


@pytest.mark.slow
def test_pyplot_has_no_new_figures_afterwards(tmp_path):
    from matplotlib import pyplot

    before = pyplot.get_fignums()
    draw(tmp_path / "a.png", **FULL)
    assert pyplot.get_fignums() == before


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"closure": TIME[:-1]}, "closure needs 81 samples like time, got 80"),
        ({"closure": TIME, "mode": ["idle"]}, "mode needs 81 samples like time, got 1"),
        ({"mode": FULL["mode"]}, "needs at least one series"),
    ],
)
def test_errors_name_the_bad_series(tmp_path, fields, message):
    with pytest.raises(ValueError, match=message):
        draw(tmp_path / "a.png", **fields)
