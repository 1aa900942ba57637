import numpy as np
import pytest

from drake_srg.experiments import thesis_localizer
from drake_srg.experiments.registry import quiet
from drake_srg.experiments.thesis_localizer import CAMERAS, judge

THESIS, OWN = "thesis's localizer", "our localizer"
GOOD = {THESIS: np.array([1e-3, 2e-3, 0.015]), OWN: np.array([1e-5, -1e-5, 1e-6])}


def failed(at_place=GOOD, own=(1e-5, 0.0, 0.0)):
    errors = {THESIS: np.full((4, 3), 1e-3), OWN: np.tile(own, (4, 1))}
    rows = judge(dict.fromkeys(CAMERAS, at_place), errors)
    return {row.quantity.partition(";")[0] for row in rows if not row.passed}


def test_good_sightings_pass():
    assert failed() == set()


@pytest.mark.parametrize(
    ("name", "error", "quantity"),
    [
        (THESIS, [0.0, 0.0, 0.0148], "error in z"),
        (OWN, [0.0, 1e-4, 0.0], "error in y"),
        (OWN, [np.nan, 0.0, 0.0], "error in x"),
    ],
)
def test_every_estimate_is_judged(name, error, quantity):
    assert failed(GOOD | {name: np.array(error)}) == {quantity}


def test_ours_must_be_nearer_everywhere():
    assert failed(own=(2e-3, 0.0, 0.0)) == {
        "places where our localizer is nearer to the centre"
    }


@pytest.mark.slow
def test_the_rule_gives_the_thesis_s_height_with_every_camera():
    result = thesis_localizer.run(quiet, grid=2)
    assert result.passed
    assert len(result.tables["region"]["x [m]"]) == 4
    assert len(result.figure.axes) == 2
