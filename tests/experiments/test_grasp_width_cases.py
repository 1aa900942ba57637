import pytest

from drake_srg.experiments import grasp_width_cases
from drake_srg.experiments.grasp_width_cases import (
    LIFT_HEIGHT,
    box,
    flat_box,
    grasp,
    rod,
    sheet,
)


@pytest.mark.parametrize("make", [sheet, rod])
def test_thinner_objects_are_lighter(make):
    thick, thin = make(0.002).config, make(0.001).config
    assert thin.mass == pytest.approx(thick.mass * {sheet: 0.5, rod: 0.25}[make])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("thing", "gap"),
    [(box(0.07), 0.0), (sheet(0.00076), 0.0), (flat_box(0.158, 0.006), 0.006)],
    ids=lambda value: getattr(value, "name", ""),
)
def test_the_hand_holds_boxes_and_sheets(thing, gap, monkeypatch):
    monkeypatch.setattr(grasp_width_cases, "_CLOSE", 1.5)
    monkeypatch.setattr(grasp_width_cases, "_HOLD", 2.0)
    result = grasp(thing)
    assert result.held
    # Closing fingers may draw a box in until the gap above it is closed.
    assert 0.05 < result.raised < LIFT_HEIGHT + gap + 0.001


@pytest.mark.slow
def test_a_box_wider_than_the_open_hand_is_not_lifted(monkeypatch):
    monkeypatch.setattr(grasp_width_cases, "_CLOSE", 0.5)
    monkeypatch.setattr(grasp_width_cases, "_HOLD", 2.0)
    result = grasp(box(0.3))
    assert not result.free
    assert result.raised < 0.1 * LIFT_HEIGHT
