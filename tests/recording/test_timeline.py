import cv2
import numpy as np
import pytest

from drake_srg.recording.timeline import (
    Timeline,
    draw_timeline,
    make_figure,
    mode_bands,
    save_png,
    style_axes,
)


def test_a_figure_has_the_given_size_and_title(tmp_path):
    plain = cv2.imread(str(save_png(make_figure(3, 2), tmp_path / "plain.png")))
    titled = cv2.imread(str(save_png(make_figure(3, 2, "t"), tmp_path / "titled.png")))
    assert plain.shape == titled.shape == (220, 330, 3)
    assert (plain == 255).all()
    assert not (titled == 255).all()


def test_the_style_keeps_the_limits():
    axes = make_figure(3, 2).subplots()
    axes.plot([0, 5], [1, 2])
    limits = axes.get_xlim(), axes.get_ylim()
    style_axes(axes, xlabel="time [s]", ylabel="q [rad]")
    assert (axes.get_xlim(), axes.get_ylim()) == limits
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time [s]", "q [rad]")


def test_an_unwritable_file_raises_an_os_error(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(FileExistsError, match="file"):
        save_png(make_figure(2, 2), tmp_path / "file" / "figure.png")


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
    "title": "kitchen",
}


def draw(path, **fields):
    return cv2.imread(str(draw_timeline(Timeline(TIME, **fields), path)))


@pytest.fixture(scope="module")
def full_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("timeline") / "full.png"
    draw(path, **FULL)
    return path


@pytest.fixture
def full(full_file):
    """The image of a timeline with everything."""
    return cv2.imread(str(full_file))


@pytest.mark.slow
def test_a_full_timeline_has_seven_panels(tmp_path, full):
    one = draw(tmp_path / "one.png", closure=FULL["closure"])
    assert full.shape[1] == one.shape[1]
    assert full.shape[0] > 3 * one.shape[0]


@pytest.mark.slow
@pytest.mark.parametrize("field", ["mode", "closure", "arm_velocity", "proximity"])
def test_every_series_is_drawn(tmp_path, full, field):
    changed = {**FULL, field: np.roll(FULL[field], 17, axis=0)}
    if field == "mode":
        changed["mode"] = changed["mode"].tolist()
    other = draw(tmp_path / "other.png", **changed)
    assert full.shape != other.shape or not np.array_equal(full, other)


@pytest.mark.slow
def test_an_arm_of_prismatic_joints_has_another_unit(tmp_path, full):
    slides = draw(tmp_path / "slides.png", **FULL, arm_slides=True)
    assert full.shape != slides.shape or not np.array_equal(full, slides)


@pytest.mark.slow
def test_equal_values_give_equal_bytes_and_leave_no_figure(tmp_path, full_file):
    from matplotlib import pyplot

    before = pyplot.get_fignums()
    draw(tmp_path / "again.png", **FULL)
    assert (tmp_path / "again.png").read_bytes() == full_file.read_bytes()
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


def test_many_modes_become_numbered_cycles():
    cycle = ["pre_grasp", "grasp", "close", "lift"]
    few, many = ["idle", *cycle * 3], ["idle", *cycle * 30]
    assert mode_bands(few)[:2] == [(0, "idle"), (1, "pre grasp")]
    bands = mode_bands(many)
    assert bands[:3] == [(0, ""), (1, "1"), (5, "2")]
    assert len(bands) == 31


def test_cycles_of_own_modes_begin_with_the_first_mode():
    assert mode_bands(["wait", "go"] * 30)[:2] == [(0, "1"), (2, "2")]
    assert mode_bands([]) == []
