import numpy as np
import pytest

from drake_srg.vision import candidates
from measure.thresholds import THRESHOLDS, Setting, show


@pytest.mark.parametrize("threshold", THRESHOLDS, ids=str)
def test_values_on_both_sides_of_the_one_in_use_are_tried(threshold):
    if isinstance(threshold.used, tuple):  # as many rounds, or more or fewer
        assert all(value != threshold.used for value in threshold.tried)
    else:
        low, high = sorted(threshold.tried, key=np.sum)
        assert np.all(low < threshold.used)
        assert np.all(threshold.used < high)


def test_each_is_there_once():
    assert len({str(threshold) for threshold in THRESHOLDS}) == len(THRESHOLDS)


def test_a_value_is_in_place_for_a_while():
    (step,) = (t for t in THRESHOLDS if str(t) == "candidates._STEP")
    used = candidates._STEP
    setting = Setting(step, 1)
    with pytest.raises(ZeroDivisionError), setting.in_place():
        assert setting.value == 2 * used
        assert setting.value == candidates._STEP
        raise ZeroDivisionError
    assert used == candidates._STEP
    with Setting().in_place():
        assert used == candidates._STEP


def test_names_tell_constants_and_values():
    step = next(t for t in THRESHOLDS if t.constant == "_STEP")
    assert str(Setting(step, 0)) == "candidates._STEP = 0.125"
    assert str(Setting()) == "in use"
    assert show((3.0, 1.0)) == "3 1"
