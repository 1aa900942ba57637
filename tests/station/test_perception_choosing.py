"""Destinations of objects by name or colour, and the labels that they need."""

import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeCell
from drake_srg.station.perception import destinations, labels, needs_labels

ONE_BIN = "task.place={bin: red_bin, bins: null}"
MUG = "objects.mug={model: package://drake_srg/sdf/mug.sdf}"
FAR = "directives.blue_bin::bottom.add_weld.X_PC.translation=[1.2, 0.5, 0.0]"


def test_a_cell_that_clears_all_does_not_choose():
    assert not needs_labels(load_scenario("clear_table"))
    assert needs_labels(load_scenario("sort_table"))


def test_objects_belong_where_their_colour_does():
    found = destinations(load_scenario("sort_table"))
    assert found["red_ball"] == "red_bin"
    assert found["blue_can"] == "blue_bin"
    assert found["green_block"] is None


def test_the_colour_of_a_model_is_that_of_its_first_visual():
    found = destinations(load_scenario("sort_table", overrides=[MUG]))
    assert found["mug"] == "blue_bin"


def test_names_count_before_colours_and_colours_before_all():
    override = "task.place.bins={red_bin: all, blue_bin: [red_can]}"
    scenario = load_scenario("sort_table", overrides=[override])
    assert [label.name for label in labels(scenario)] == ["red_can", "all"]
    found = destinations(scenario)
    assert (found["red_can"], found["red_ball"]) == ("blue_bin", "red_bin")


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ([FAR], r"^task\.place\.bins\.blue_bin: out of reach: "),
        (
            ["task.place.bins={floor: {colour: green}}"],
            r"^task\.place\.bins\.floor: 'floor' is no bin",
        ),
        (
            [MUG, "task.pick=[mug]", ONE_BIN],
            r"^objects\.mug: the localizer cannot tell it from others; give it a shape",
        ),
        (
            ["objects.twin={shape: !Sphere {radius: 0.03}, mass: 0.05, friction: 0.6,"
             " color: [0.75, 0.12, 0.1]}", "task.pick=[twin]", ONE_BIN],
            r"^objects\.twin: looks like red_ball; give it another",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_told_before_the_run(overrides, message):
    scenario = load_scenario("sort_table", overrides=overrides)
    with pytest.raises(ScenarioError, match=message):
        MakeCell(scenario)
