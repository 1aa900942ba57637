"""The bins of scenarios, measured on their models."""

import pytest

from drake_srg.scenario import load_scenario
from drake_srg.station.perception import bin_boxes, bin_floor


def test_the_floor_of_a_bin_is_above_the_table():
    assert bin_floor(load_scenario("clear_table"), "bin") == pytest.approx(0.02)


def test_every_bin_has_its_own_floor_below_its_rim():
    scenario = load_scenario("sort_table")
    boxes = bin_boxes(scenario)
    assert len(boxes) == 2
    for name, (low, high) in boxes.items():
        assert low[2] < bin_floor(scenario, name) < high[2]
