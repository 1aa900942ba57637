"""The scenes of the experiments with tables."""

import pytest

from drake_srg.experiments import clearing, clearing_conditions, sorting
from drake_srg.scenario import load_scenario
from drake_srg.station.perception import destinations


@pytest.mark.parametrize("experiment", [clearing, clearing_conditions, sorting])
def test_scenes_differ_by_seed(experiment):
    for name, overrides in experiment.SCENES.values():
        drawn = [load_scenario(name, seed=i, overrides=overrides) for i in (8, 9)]
        assert repr(drawn[0].objects) != repr(drawn[1].objects)


def test_by_name_each_bin_gets_both_colours():
    name, overrides = sorting.SCENES["name, two bins"]
    found = destinations(load_scenario(name, seed=8, overrides=overrides))
    assert (found["red_block"], found["blue_can"]) == ("red_bin", "red_bin")
    assert (found["blue_block"], found["red_can"]) == ("blue_bin", "blue_bin")
    assert found["green_block"] is None


@pytest.mark.parametrize("scene", ["colour, varied", "colour, linkage gripper"])
def test_by_colour_the_variants_sort_like_sort_table(scene):
    name, overrides = sorting.SCENES[scene]
    found = destinations(load_scenario(name, seed=8, overrides=overrides))
    for thing, into in found.items():
        colour = thing.partition("_")[0]
        assert into == (None if colour == "green" else f"{colour}_bin")
