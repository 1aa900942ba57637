"""Maps of where loads go."""

import dataclasses as dc

import numpy as np
import pytest

from drake_srg.common.systems import input_ports
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeCell
from drake_srg.station.perception import (
    bin_boxes,
    clearing_destinations,
    destination_map_limits,
    foot_box,
)
from drake_srg.vision.height_map import height_map
from drake_srg.vision.surfaces import Surface


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
