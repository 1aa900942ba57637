"""Pictures: legends keep clear of the data, shares end at 1, labels fit."""

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
