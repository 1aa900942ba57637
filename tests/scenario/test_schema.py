import dataclasses as dc
import typing

from pydrake.common.yaml import yaml_dump_typed

from drake_srg.scenario import Scenario
from drake_srg.scenario.planner import with_planner_tag
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
