"""Scenarios that clear a table of many objects."""

import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario


def test_all_are_the_names_of_all_objects():
    task = load_scenario("clear_table", overrides=["clutter.count=3"]).task
    assert task.pick == ""
    assert task.clear.objects == ["clutter_1", "clutter_2", "clutter_3"]


@pytest.mark.parametrize(
    ("scenario", "override", "message"),
    [
        ("clear_table", "clutter.count=0", "task.pick: needs at least one object"),
        ("clear_table", "clutter.count=40", "task.region: must be larger, no free"),
        ("clear_table", "task.pick=spoon", "task.pick: unknown object 'spoon'"),
        ("clear_table", "task.pick=clutter_1", "task.pick: must be all with"),
        ("clear_table", "task.pick=[clutter_1]", "objects apart, got a list"),
        ("clear_table", "task.pick=null", "objects apart, got null"),
        ("clear_table", "clutter=null", "task.pick: needs at least one object"),
        ("clear_table", "objects=3", "objects: must be a mapping, got 3"),
        ("clear_table", "clutter.kinds=null", "clutter.kinds: must be a mapping"),
        ("clear_table", "clutter.kinds.mug=3", "clutter.kinds.mug: must be a mapping"),
        ("clear_table", "task.clear=5", "task.clear: must be "),
        ("clear_table", "task.clear.objects=[a]", "task.clear.objects: must be absent"),
        (
            "clear_table",
            "task.place.bin=basket",
            "task.place.bin: unknown model 'basket' (allowed: bin, floor, ",
        ),
        ("clear_table", "task.place.bin=''", "task.place.bin: must name the bin"),
        ("clear_table", "task.clear.region.max=[0, 0]", "region: min must be below"),
        ("clear_table", "task.clear.region.max=[2, 1]", "region: must be on the table"),
        ("kitchen", "task.pick=all", "task.place.bin: must name the bin"),
        ("kitchen", "task.pick=[soup_can]", "task.pick: must be text, got a list"),
        ("kitchen", "object.tilt=[1, 0]", "soup_can.tilt: needs drop"),
    ],
)
def test_mistakes_are_named(scenario, override, message):
    with pytest.raises(ScenarioError) as caught:
        load_scenario(scenario, overrides=[override])
    text = str(caught.value)
    assert text.startswith(f"{scenario}: ")
    assert message in text
    assert "\n" not in text
