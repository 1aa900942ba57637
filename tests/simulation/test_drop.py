import pytest

from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import household_object
from drake_srg.simulation.drop import (
    HEIGHT,
    LATE,
    QUIET,
    SOON,
    DropOutcome,
    above_table,
    drop,
)
from drake_srg.types import Box

BRICK = ObjectConfig(shape=Box([0.08, 0.06, 0.05]), mass=0.3, friction=0.6)


def test_an_object_is_let_go_just_above_the_table():
    scenario = above_table(BRICK)
    X_WO = scenario.objects["thing"].pose.GetDeterministicValue()
    assert X_WO.translation()[2] == pytest.approx(0.025 + HEIGHT)
    assert BRICK.pose is None


@pytest.mark.slow
def test_a_box_rests_soon():
    outcome = drop(BRICK)
    assert outcome.rests
    assert outcome.after == pytest.approx(SOON)
    assert outcome.speed < QUIET
    assert outcome.moved < 1e-3


@pytest.mark.slow
def test_a_model_stands_on_its_origin():
    assert drop(household_object("bowl")).rests


@pytest.mark.slow
@pytest.mark.parametrize("name", ["011_banana", "029_plate"])
def test_what_rattles_on_a_rigid_table_rests_here(name):
    assert drop(household_object(name)).rests


@pytest.mark.slow
def test_what_moves_is_watched_until_the_end(monkeypatch):
    monkeypatch.setitem(drop.__globals__, "QUIET", 0.0)
    outcome = drop(BRICK)
    assert not outcome.rests
    assert outcome.after == pytest.approx(LATE)


@pytest.mark.slow
def test_what_falls_off_the_table_does_not_rest(monkeypatch):
    monkeypatch.setitem(drop.__globals__, "_PLACE", (3.0, 0.0))
    assert not drop(BRICK).rests


def test_outcomes_in_words():
    words = str(DropOutcome(True, 1.2, 4e-4, 1e-4))
    assert words.startswith("rests: 0.4 mm/s 1.2 s after a drop from 5 mm")
    assert str(DropOutcome(False, 3.0, 0.1, 0.0)).startswith(
        "does not rest: 100.0 mm/s"
    )
