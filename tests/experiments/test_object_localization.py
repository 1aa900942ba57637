import numpy as np
import pytest

from drake_srg.experiments.object_localization import (
    RESTING,
    UPRIGHT,
    Found,
    look,
    make_result,
    with_color,
)
from drake_srg.objects.household import household_object

GOOD = Found(3e-4, np.deg2rad(0.2), certain=True)
LOST = Found(np.nan, np.nan, certain=False)


def rows(**ways):
    result = make_result({"cup": {UPRIGHT: [GOOD], RESTING: [], **ways}})
    return {(row.name, row.quantity): row for row in result.rows}, result


def test_good_sightings_pass():
    found, result = rows()
    assert result.passed
    assert found["cup, upright", "median error of the centre"].measured == 0.3
    assert found["all", "share of these within 1 mm and 1 degree"].measured == 1.0


@pytest.mark.parametrize("bad", [Found(2e-3, 0.0, True), Found(0.0, 0.1, True)])
def test_errors_of_place_and_turn_count(bad):
    assert not rows(**{UPRIGHT: [bad]})[1].passed
    found, _ = rows(**{UPRIGHT: [GOOD, GOOD, bad]})
    assert found["cup, upright", "median error of the centre"].passed
    share = found["all", "share of these within 1 mm and 1 degree"]
    assert (share.measured, share.passed) == (pytest.approx(2 / 3), False)


def test_what_is_not_certain_is_counted_and_not_judged():
    found, result = rows(**{UPRIGHT: [GOOD, LOST, Found(0.1, 1.0, False)]})
    assert result.passed
    assert found["all", "share located with certainty"].measured == 1 / 3


def test_an_object_that_is_never_located_fails():
    assert not rows(**{UPRIGHT: [LOST]})[1].passed


def test_a_grey_part_gives_way_to_a_coloured_one():
    lower, upper = (
        getattr(with_color("wrench", household_object("wrench")).color_range, bound)
        for bound in ("lower", "upper")
    )
    assert lower[0] < 215 < upper[0]  # the blue panel


@pytest.mark.slow
@pytest.mark.parametrize("name", ["004_sugar_box", "mug"])
def test_the_camera_sees_position_and_yaw(name):
    found = look(name, upright=1, resting=0)[UPRIGHT]
    assert all(f.certain and f.off < 1e-3 and f.turn < np.deg2rad(1.0) for f in found)
