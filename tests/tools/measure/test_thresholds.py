import dataclasses as dc

import numpy as np
import pytest

from drake_srg.scenario.yaml_typed import load_typed
from drake_srg.vision.config import LocalizerThresholds
from measure.thresholds import THRESHOLDS, Setting, show

STEP = next(t for t in THRESHOLDS if t.path == "candidates.step")


@pytest.mark.parametrize("threshold", THRESHOLDS, ids=str)
def test_values_on_both_sides_of_the_one_in_use_are_tried(threshold):
    if isinstance(threshold.used, list):  # of other length or values
        assert all(value != threshold.used for value in threshold.tried)
    else:
        low, high = sorted(threshold.tried)
        assert low < threshold.used < high


@pytest.mark.parametrize("threshold", THRESHOLDS, ids=str)
@pytest.mark.parametrize("which", range(2))
def test_a_scenario_could_set_the_values_that_are_tried(threshold, which):
    config = Setting(threshold, which).config()
    assert load_typed(LocalizerThresholds, dc.asdict(config), "tried") == config
    assert config != LocalizerThresholds()


def test_every_value_of_the_config_is_a_threshold():
    def count(config):
        values = [getattr(config, field.name) for field in dc.fields(config)]
        return sum(count(v) if dc.is_dataclass(v) else 1 for v in values)

    assert len({t.path for t in THRESHOLDS}) == count(LocalizerThresholds())


def test_a_setting_changes_one_value():
    config = Setting(STEP, 1).config()
    assert config.candidates.step == 2 * LocalizerThresholds().candidates.step
    config.candidates.step = LocalizerThresholds().candidates.step
    assert config == LocalizerThresholds()
    assert Setting().config() == LocalizerThresholds()


def test_settings_are_shown_by_path_and_value():
    assert str(Setting(STEP, 0)) == "candidates.step = 0.125"
    assert str(Setting()) == "in use"
    assert show([3.0, 1.0]) == "3 1"
    assert show(np.float64(0.5)) == "0.5"
