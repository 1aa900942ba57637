"""Pictures: legends keep clear of the data, shares end at 1, labels and titles fit."""

import numpy as np
import pytest

import experiments.runner as ex
from drake_srg.recording.timeline import make_figure
from experiments.runner.claims import Row, Trials

X = np.linspace(0.0, 1.0, 5)
TRIALS = Trials(
    [{"kind": kind, "x": X, "y": k * X, "z": -k * X} for k, kind in enumerate("abc")]
)


def drawn(*panels, trials=TRIALS, rows=()):
    """Return a figure with panels, laid out."""
    experiment = ex.Experiment(
        "A title.", list, dict, by=("kind",), picture=list(panels)
    )
    figure = make_figure(6.0, 4.0)
    experiment.draw(figure, trials, rows)
    figure.draw_without_rendering()
    return figure


def boxes(figure):
    """Return the boxes of all axes and of all legends [pixels]."""
    own = [legend for axes in figure.axes if (legend := axes.get_legend())]
    legends = [legend.get_window_extent() for legend in (*own, *figure.legends)]
    return [axes.get_window_extent() for axes in figure.axes], legends


@pytest.mark.parametrize(
    ("panels", "count"),
    [
        ([ex.Curves("x", "y"), ex.Curves("x", "z")], 1),
        ([ex.Curves("x", "y"), ex.Curves("x", "z", where={"kind": "a"})], 1),
        ([ex.Curves("x", "y", reference="z"), ex.Points("x", "z")], 2),
    ],
)
def test_a_legend_covers_no_panel_and_is_within_the_figure(panels, count):
    figure = drawn(*panels)
    axes, legends = boxes(figure)
    assert len(legends) == count
    for legend in legends:
        assert not any(legend.overlaps(panel) for panel in axes)
        assert figure.bbox.x0 <= legend.x0 <= legend.x1 <= figure.bbox.x1 + 1
        assert figure.bbox.y0 <= legend.y0 <= legend.y1 <= figure.bbox.y1 + 1


def test_numbers_stay_on_every_axis():
    for axes in drawn(ex.Curves("x", "y"), ex.Curves("x", "y")).axes:
        assert all(label.get_visible() for label in axes.get_yticklabels())


def legend_titles(figure):
    own = [legend for axes in figure.axes if (legend := axes.get_legend())]
    return [legend.get_title().get_text() for legend in (*own, *figure.legends)]


def test_a_legend_of_numbers_names_the_parameter():
    wide = Trials([{"width": w, "kind": "a", "x": X, "y": w * X} for w in (1.0, 2.0)])
    by_width = ex.Curves("x", "y", label=["width [m]"])
    assert legend_titles(drawn(by_width, by_width, trials=wide)) == ["width [m]"]
    both = ex.Curves("x", "y", label=["kind", "width [m]"])
    assert legend_titles(drawn(both, trials=wide)) == ["kind, width [m]"]
    assert legend_titles(drawn(ex.Curves("x", "y"))) == [""]


def test_a_name_has_the_same_colour_in_all_panels():
    both, one = drawn(
        ex.Curves("x", "y"), ex.Curves("x", "y", where={"kind": "b"})
    ).axes
    assert one.lines[0].get_color() == both.lines[1].get_color()


def test_a_label_tells_the_style_of_each_measure():
    (axes,) = drawn(ex.Curves("x", ("y", "z"))).axes
    assert axes.get_ylabel() == "y,\nz (dashed)"


def test_pictures_that_a_function_draws_have_the_title():
    def draw(figure, trials, rows):
        figure.add_subplot()

    figure = make_figure(6.0, 4.0)
    ex.Experiment("A title.", list, dict, picture=draw).draw(figure, TRIALS, ())
    assert figure.get_suptitle() == "A title."


def test_names_and_captions_of_images_stay_within_their_image():
    image = np.zeros((8, 8, 3), np.uint8)
    trials = Trials(
        [{"kind": f"an object of a rather long name {k}", "image": image} for k in "ab"]
    )
    caption = "too wide: 158 > 146 mm, slips 280 mm at 12 N"
    figure = drawn(ex.Images(caption=lambda entry: caption, across=2), trials=trials)
    for own in figure.axes[0].child_axes:
        panel = own.get_window_extent()
        for text in (own.xaxis.label, own._left_title):
            box = text.get_window_extent()
            assert panel.x0 - 1 <= box.x0 <= box.x1 <= panel.x1 + 6
            assert figure.bbox.y0 <= box.y0 <= box.y1 <= figure.bbox.y1


def bars(quantity):
    return [
        Row(f"a rather long name of {name}", quantity, "a number", value, "", True, 0.1)
        for name, value in (("one", 0.5), ("two", 1.0))
    ]


def test_bars_of_shares_end_at_one_and_names_stand_once():
    rows = bars("held, share") + bars("the lost ones, share")
    figure = drawn(
        ex.Bars(["held, share"]), ex.Bars(["the lost ones, share"]), rows=rows
    )
    left, right = figure.axes
    assert left.get_xlim() == (0.0, 1.02)
    assert all(label.get_visible() for label in left.get_yticklabels())
    assert not any(label.get_visible() for label in right.get_yticklabels())
    for axes in figure.axes:
        label = axes.xaxis.label.get_window_extent()
        assert 0.0 <= label.x0 <= label.x1 <= figure.bbox.x1
