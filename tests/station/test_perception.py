import dataclasses as dc

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.systems import input_ports
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeCell, MakeStation
from drake_srg.station.perception import (
    AddLocalizer,
    bin_boxes,
    bin_floor,
    clearing_destinations,
    destination_map_limits,
    destinations,
    foot_box,
    labels,
    needs_labels,
)
from drake_srg.vision.height_map import height_map
from drake_srg.vision.surfaces import Surface


@pytest.mark.slow
def test_a_localizer_without_an_object_that_it_knows_is_refused():
    mug = "object.model=package://drake_srg/sdf/mug.sdf"
    scenario = load_scenario("kitchen", overrides=[mug])
    builder = DiagramBuilder()
    station = builder.AddNamedSystem("station", MakeStation(scenario))
    with pytest.raises(ScenarioError, match=r"^objects: the localizer knows none"):
        AddLocalizer(builder, scenario, station)


@pytest.mark.slow
def test_the_thesis_s_localizer_takes_one_camera():
    scenario = load_scenario("assistive_arm_thesis", seed=0)
    scenario.localizer.cameras = ["ceiling", "overview"]
    builder = DiagramBuilder()
    with pytest.raises(
        ScenarioError, match=r"localizer\.cameras: must name one camera"
    ):
        AddLocalizer(builder, scenario, builder.AddSystem(MakeStation(scenario)))


def test_the_floor_of_a_bin_is_above_the_table():
    assert bin_floor(load_scenario("clear_table"), "bin") == pytest.approx(0.02)


def test_every_bin_has_its_own_floor_below_its_rim():
    scenario = load_scenario("sort_table")
    boxes = bin_boxes(scenario)
    assert len(boxes) == 2
    for name, (low, high) in boxes.items():
        assert low[2] < bin_floor(scenario, name) < high[2]


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
            r"^task\.place\.bins\.floor: 'floor' is too low",
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


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("clear_table", overrides=["clutter.count=1"])


def test_destinations_are_the_bins_or_the_places_of_a_row(scenario):
    (place,) = clearing_destinations(scenario)
    np.testing.assert_allclose(place.middle, [0.34, -0.56], atol=1e-9)
    assert place.place is None
    row = clearing_destinations(load_scenario("row_table"))
    assert [round(float(p.middle[0]), 6) for p in row] == [0.25, 0.37, 0.49, 0.61]
    assert all(p.place is not None for p in row)


def around_the_bin(scenario):
    """The bin's corners, the surface around it, and points on that every 2 mm [m]."""
    low, high = bin_boxes(scenario)["bin"]
    around = Surface((low[0] - 0.1, low[1] - 0.1), (high[0] + 0.1, high[1] + 0.1), 0.0)
    ranges = (
        np.arange(*ends, 0.002) for ends in zip(around.min, around.max, strict=True)
    )
    return low, high, around, *np.meshgrid(*ranges)


def test_a_hand_beside_a_bin_hides_nothing_inside(scenario):
    low, high, around, x, y = around_the_bin(scenario)
    inside = (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])
    hand = (abs(x - 0.4) < 0.05) & (y > high[1]) & (y < high[1] + 0.08)
    z = np.where(hand, 0.5, np.where(inside, high[2], 0.0))
    cloud = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    (place,) = clearing_destinations(scenario)

    def unknown(**limits):
        seen = height_map([cloud], around, **limits)
        return np.mean(np.isnan(seen.height[place.contains(seen)]))

    thing, over_edge = destination_map_limits(scenario)
    assert unknown(thing=thing, over_edge=over_edge) < 0.05
    assert unknown(over_edge=True) > 0.9  # it seems to be the robot


def test_an_arm_beside_a_bin_is_no_load(scenario):
    *_, around, x, y = around_the_bin(scenario)
    elbow = np.hypot(x - 0.3, y - around.max[1]) < 0.05
    cloud = np.stack([x, y, np.where(elbow, 0.3, 0.0)], axis=-1).reshape(-1, 3)
    thing, over_edge = destination_map_limits(scenario)
    seen = height_map([cloud], around, thing=thing, over_edge=over_edge)
    assert np.nanmax(seen.height) == 0.0


def test_only_where_loads_go_do_all_cameras_look(scenario):
    cell = MakeCell(scenario)
    ports = {
        name: set(input_ports(cell.GetSubsystemByName(name)))
        for name in ("height_mapper", "destination_mapper")
    }
    more = {"bin.depth_image", "bin.body_pose_in_world"}
    assert ports["destination_mapper"] - ports["height_mapper"] == more


@pytest.mark.slow
def test_a_camera_above_the_bin_sees_what_is_beyond_its_walls(scenario):
    def unseen(cameras):
        chosen = dc.replace(scenario.task.place, cameras=cameras)
        task = dc.replace(scenario.task, place=chosen)
        aside = dc.replace(scenario.arm, home=[0.6, *scenario.arm.home[1:]])
        cell = MakeCell(dc.replace(scenario, task=task, arm=aside))
        context = cell.CreateDefaultContext()
        mapper = cell.GetSubsystemByName("destination_mapper")
        seen = mapper.get_output_port(0).Eval(mapper.GetMyContextFromRoot(context))
        (place,) = clearing_destinations(scenario)
        beyond = place.contains(seen, 0.04) & ~place.contains(seen, 0.025)
        return np.mean(np.isnan(seen.height[beyond]))

    assert unseen(["bin"]) < 0.02
    assert unseen([]) > 0.3


def test_the_foot_of_the_arm_is_link_0(scenario):
    low, high = foot_box(scenario)
    assert np.all(low[:2] < [-0.08, -0.08])
    assert np.all(np.abs(high - [0.1, 0.1, 0.15]) < 0.05)
