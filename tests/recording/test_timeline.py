import dataclasses as dc

import cv2
import numpy as np
import pytest

from drake_srg.recording.timeline import (
    Labels,
    Timeline,
    draw_timeline,
    make_figure,
    mode_bands,
    run_timeline,
    save_png,
    style_axes,
)
from drake_srg.types import Mode


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
ROWS = np.outer(TIME, np.arange(1.0, 5.0))
LOG = {
    "time": TIME,
    "mode": np.repeat([0.0, 1.0], [40, 41]),
    "arm.state_measured": ROWS,
    "arm.torque_measured": np.cos(ROWS[:, :2]),
    "gripper.state_measured": ROWS,
    "gripper.closure_commanded": TIME / 4,
    "gripper.proximity": np.where(TIME[:, None] > 1, 0.02, np.inf),
    "contact_force": TIME**2,
    "object_pose.can": np.tile([0.1, 0.2, 0.3, 1, 0, 0, 0], (81, 1)),
}
LABELS = Labels("title", "can", ("left_base_joint", "right_joint"), ("left_tip",))


def test_columns_of_a_log_become_panels_with_names_and_units():
    timeline = run_timeline(LOG, LABELS)
    assert timeline.title == "title"
    assert timeline.mode == [list(Mode)[i].value for i in [0] * 40 + [1] * 41]
    assert [(label, list(names)) for label, _, names in timeline.panels] == [
        ("finger joints\n[deg]", ["left base", "right"]),
        ("commanded\nclosure", []),
        ("proximity\n[mm]", ["left tip"]),
        ("grip force\n[N]", []),
        ("arm velocity\n[deg/s]", ["joint 1", "joint 2"]),
        ("arm torque\n[N m]", ["joint 1", "joint 2"]),
        ("object height\n[mm]", []),
    ]
    values = [values for _, values, _ in timeline.panels]
    np.testing.assert_allclose(values[0], np.rad2deg(ROWS[:, :2]))
    np.testing.assert_array_equal(values[1][:, 0], TIME / 4)
    np.testing.assert_allclose(values[4], np.rad2deg(ROWS[:, 2:]))
    np.testing.assert_allclose(values[6], 300.0)


def test_what_a_cell_does_not_measure_has_no_panel():
    names = ("time", "mode", "arm.state_measured")
    timeline = run_timeline({name: LOG[name] for name in names}, Labels("title"))
    (panel,) = timeline.panels
    assert panel[0] == "arm velocity\n[deg/s]"


def test_an_arm_of_prismatic_joints_has_other_units():
    timeline = run_timeline(LOG, dc.replace(LABELS, arm_slides=True))
    (label, values, _), (force, _, _) = timeline.panels[4:6]
    assert (label, force) == ("arm velocity\n[mm/s]", "arm force\n[N]")
    np.testing.assert_allclose(values, 1e3 * ROWS[:, 2:])


def draw(path, **changes):
    timeline = dc.replace(run_timeline(LOG, LABELS), **changes)
    return cv2.imread(str(draw_timeline(timeline, path)))


@pytest.mark.slow
def test_panels_and_modes_are_drawn_and_equal_values_give_equal_bytes(tmp_path):
    from matplotlib import pyplot

    before = pyplot.get_fignums()
    full = draw(tmp_path / "full.png")
    draw(tmp_path / "again.png")
    assert (tmp_path / "again.png").read_bytes() == (tmp_path / "full.png").read_bytes()
    assert pyplot.get_fignums() == before  # no figure is left
    one = draw(tmp_path / "one.png", panels=run_timeline(LOG, LABELS).panels[:1])
    assert full.shape[1] == one.shape[1]
    assert full.shape[0] > 3 * one.shape[0]
    assert not np.array_equal(full, draw(tmp_path / "modes.png", mode=["lift"] * 81))


@pytest.mark.parametrize(
    ("panels", "mode", "message"),
    [
        (
            [("a\n[m]", TIME[:-1], ())],
            (),
            r"a \[m\] needs 81 samples like time, got 80",
        ),
        ([("a", TIME, ())], ["idle"], "mode needs 81 samples like time, got 1"),
        ([], ["idle"] * 81, "needs at least one series"),
    ],
)
def test_errors_name_the_bad_series(panels, mode, message):
    with pytest.raises(ValueError, match=message):
        Timeline(TIME, panels, mode)


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
