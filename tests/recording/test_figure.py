import cv2
import pytest

from drake_srg.recording.figure import make_figure, save_png, style_axes


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
