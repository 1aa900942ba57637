"""Scenarios that clear a table of many objects."""

import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario


def test_all_are_the_names_of_all_objects():
    task = load_scenario("clear_table", overrides=["clutter.count=3"]).task
    assert task.pick == ""
    assert task.clear.objects == ["clutter_1", "clutter_2", "clutter_3"]


def test_all_leave_out_what_is_absent():
    overrides = ["objects.red_can.present=false"]
    task = load_scenario("sort_table", overrides=overrides).task
    assert len(task.clear.objects) == 6
    assert "red_can" not in task.clear.objects


@pytest.mark.parametrize(
    ("pick", "names", "colour", "objects"),
    [
        ("all", [], "", 7),
        ("red_can", ["red_can"], "", 1),
        ("[red_can, blue_ball]", ["red_can", "blue_ball"], "", 2),
        ("{colour: red}", [], "red", 7),
    ],
)
def test_what_is_picked_for_a_bin(pick, names, colour, objects):
    overrides = [f"task.pick={pick}", "task.place={bin: red_bin, bins: null}"]
    task = load_scenario("sort_table", overrides=overrides).task
    (selection,) = task.place.bins.values()
    assert (selection.names, selection.colour) == (names, colour)
    assert len(task.clear.objects) == objects


def test_a_row_has_a_place_for_each_name():
    task = load_scenario("row_table").task
    assert task.clear.objects == ["red_block", "red_can", "blue_block", "blue_can"]
    assert task.place.bins == {}


def test_a_list_may_name_the_one_object_to_place():
    task = load_scenario("kitchen", overrides=["task.pick=[soup_can]"]).task
    assert task.pick == "soup_can"


@pytest.mark.parametrize(
    ("scenario", "override", "message"),
    [
        ("clear_table", "clutter.count=0", "task.pick: needs at least one object"),
        ("clear_table", "clutter.count=40", "task.region: must be larger, no free"),
        ("clear_table", "task.pick=spoon", "task.pick: unknown object 'spoon'"),
        ("clear_table", "task.pick=[spoon]", "task.pick: unknown object 'spoon'"),
        ("clear_table", "task.pick=[]", "task.pick: must name at least one object"),
        ("clear_table", "task.pick=[[]]", "task.pick: unknown object a list"),
        ("clear_table", "task.pick=null", "{colour: COLOUR}, got null"),
        ("clear_table", "task.pick={color: red}", "{colour: COLOUR}, got a mapping"),
        (
            "clear_table",
            "task.pick={colour: rde}",
            "task.pick.colour: unknown 'rde' (did you mean",
        ),
        (
            "clear_table",
            "task.pick=[clutter_1]",
            "objects.clutter_1.known: must be true",
        ),
        ("sort_table", "task.pick=red_can", "must be all with task.place.bins, got"),
        ("sort_table", "task.pick=[red_ball, red_ball]", "must be all with task.place"),
        ("sort_table", "task.place.bin=red_bin", "needs one of bin, bins and row"),
        ("row_table", "task.pick=all", "must be a list of names with task.place.row"),
        ("row_table", "task.place.bin=table", "needs one of bin, bins and row, got"),
        (
            "sort_table",
            "task.place={bin: [red_bin], bins: null}",
            "task.place.bin: must be text, got a list",
        ),
        ("clear_table", "task.place.row={}", "one of bin, bins and row, got bin and"),
        ("row_table", "task.place.row=3", "task.place.row: must be a mapping"),
        ("sort_table", "task.place.bins=3", "task.place.bins: must be a mapping"),
        (
            "sort_table",
            "task.place.bins.blue_bin.colour=red",
            "task.place.bins.red_bin: must not take 'red', which 'blue_bin' takes",
        ),
        (
            "sort_table",
            "task.place.bins.blue_bin.names=[red_can]",
            "task.place.bins.blue_bin: needs either names or a colour",
        ),
        ("sort_table", "task.place.bins.red_bin=[can]", "bins.red_bin: unknown object"),
        ("sort_table", "task.place.bins.left=[red_can]", "unknown model 'left'"),
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
        ("kitchen", "task.place.cameras=[ceiling]", "cameras: needs task.place.bin"),
        (
            "clear_table",
            "task.place.cameras=[bon]",
            "task.place.cameras: unknown camera 'bon' (allowed: bin, ceiling, overview",
        ),
        ("kitchen", "task.pick=all", "task.place.bin: must name the bin"),
        ("kitchen", "task.pick=[soup_can, a]", "task.pick: must name one object with"),
        ("kitchen", "task.pick={colour: red}", "task.place.bin: must name the bin for"),
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
