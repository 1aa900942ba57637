import pytest

from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import household_object
from drake_srg.scenario import load_scenario
from drake_srg.simulation.drop import (
    HEIGHT,
    LATE,
    QUIET,
    SOON,
    DropOutcome,
    drop,
    table_scenario,
)
from drake_srg.types import Box

BRICK = ObjectConfig(shape=Box([0.08, 0.06, 0.05]), mass=0.3, friction=0.6)


def test_only_the_robot_and_its_sensors_are_left_out():
    kitchen, scenario = load_scenario("kitchen"), table_scenario(BRICK)
    models = [d.add_model.name for d in scenario.directives if d.add_model]
    assert models == ["table", "floor"]
    for key in ("time_step", "discrete_contact_approximation", "contact_model"):
        found, expected = (getattr(s.plant_config, key) for s in (scenario, kitchen))
        assert found == expected
    assert list(scenario.objects) == ["thing"]
    z = scenario.objects["thing"].pose.GetDeterministicValue().translation()[2]
    assert z == pytest.approx(kitchen.table.height + 0.025 + HEIGHT)
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
def test_what_moves_is_watched_until_the_end(monkeypatch):
    monkeypatch.setitem(drop.__globals__, "QUIET", 0.0)
    outcome = drop(BRICK)
    assert not outcome.rests
    assert outcome.after == pytest.approx(LATE)


@pytest.mark.slow
def test_what_falls_off_the_table_does_not_rest(monkeypatch):
    def without_table(*args):
        scenario = table_scenario(*args)
        scenario.directives = [
            d for d in scenario.directives if d.add_model.name == "floor"
        ]
        return scenario

    monkeypatch.setitem(drop.__globals__, "table_scenario", without_table)
    outcome = drop(BRICK)
    assert outcome.speed < QUIET  # on the floor
    assert not outcome.rests


def test_outcomes_in_words():
    words = str(DropOutcome(True, 1.2, 4e-4, 1e-4))
    assert words.startswith("rests: 0.4 mm/s 1.2 s after a drop from 5 mm")
    assert str(DropOutcome(False, 3.0, 0.1, 0.0)).startswith(
        "does not rest: 100.0 mm/s"
    )
