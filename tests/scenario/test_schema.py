import dataclasses as dc
import typing

import pytest
from pydrake.common.yaml import yaml_dump_typed

from drake_srg.gripper import SrgPositionDriver
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.scenario.planner import with_planner_tag
from drake_srg.scenario.schema import accept_driver
from drake_srg.scenario.typed_yaml import load_typed, parse_yaml


def test_the_defaults_are_valid_values():
    text = yaml_dump_typed(Scenario())
    tree = with_planner_tag(parse_yaml(text, "defaults"), "defaults")
    loaded = load_typed(Scenario, tree, "defaults")
    assert yaml_dump_typed(loaded) == text


def dataclasses_within(kind):
    """Return a dataclass and those that its fields may hold."""
    if not dc.is_dataclass(kind):
        return set().union(*map(dataclasses_within, typing.get_args(kind)))
    inner = (dataclasses_within(field.type) for field in dc.fields(kind))
    return {kind}.union(*inner)


def test_fields_have_types_that_drake_can_read():
    found = dataclasses_within(Scenario)
    assert len(found) > 20
    texts = {k.__name__ for k in found for f in dc.fields(k) if isinstance(f.type, str)}
    assert texts == set()


@dc.dataclass(kw_only=True)
class Squeezer(SrgPositionDriver):
    """A driver of one's own."""

    squeeze: float = 0.5


@pytest.fixture
def gripper_type(monkeypatch):
    """Restores the type of `Scenario.gripper` after the test."""
    (field,) = (field for field in dc.fields(Scenario) if field.name == "gripper")
    monkeypatch.setattr(field, "type", field.type)
    monkeypatch.setitem(Scenario.__annotations__, "gripper", field.type)


def test_an_accepted_driver_is_chosen_by_its_tag(gripper_type):
    accept_driver(Squeezer)
    override = "gripper=!Squeezer {squeeze: 0.7, trigger: touch}"
    driver = load_scenario("kitchen", overrides=[override]).gripper
    assert isinstance(driver, Squeezer)
    assert (driver.squeeze, driver.trigger) == (0.7, "touch")
    assert type(load_scenario("kitchen").gripper) is SrgPositionDriver
