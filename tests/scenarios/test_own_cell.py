"""A user's own cell runs on every kind of scenario with a discrete plant."""

import dataclasses as dc

import pytest
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.systems import export_outputs
from drake_srg.scenario import is_continuous, list_scenarios, load_scenario
from drake_srg.simulation import Simulate
from drake_srg.station import MakeCell, MakeStation
from drake_srg.theses.script import Script, ScriptStep

pytestmark = pytest.mark.slow

# By name, because every worker would load all scenarios to collect the tests.
CONTINUOUS = {
    "assistive_arm_fast",
    "assistive_arm_varied",
    "carry_together",
    "carry_together_varied",
    "conveyor",
    "handover",
    "handover_varied",
    "kitchen_fast",
    "kitchen_fast_half",
    "kitchen_servoing",
    "kitchen_varied",
    "learn_kitchen",
}
# What the user's own cell gives on these is compared with what ours gives.
COMPARED = ("kitchen_tendon", "thesis_kitchen")
# These have the systems of another scenario, with other numbers or objects.
ALIKE = {
    "assistive_arm_before",
    "assistive_arm_flat",
    "assistive_arm_varied_accurate",
    "clear_heap",
    "clear_heap_fast",
    "clear_table_fast",
    "clear_table_varied",
    "gripper_bench_accurate",
    "gripper_bench_fast",
    "kitchen_tendon_specimen",
    "kitchen_varied_accurate",
    "row_table",
    "sort_table_varied",
    "srg_specimen",
    "thesis_kitchen_tendon",
}
DISCRETE = sorted(set(list_scenarios()) - CONTINUOUS - ALIKE - set(COMPARED))


def own_station(scenario):
    """Return a station under another name."""
    station = MakeStation(scenario)
    station.set_name("my_station")
    return station


def own_cell(scenario):
    """Return a cell nested in a diagram of the user's."""
    builder = DiagramBuilder()
    cell = builder.AddNamedSystem("inner", MakeCell(scenario, make_station=own_station))
    export_outputs(builder, cell)
    return builder.Build()


def brief(name):
    """Return a scenario whose planner or script ends after 0.1 s."""
    scenario = load_scenario(name, seed=0)
    if isinstance(scenario.planner, Script):
        step = ScriptStep(mode="home", duration=0.1)
        scenario = dc.replace(scenario, planner=Script(steps=[step]))
    scenario.planner.time_budget = 0.1
    clutter = [n for n in scenario.objects if n.startswith("clutter_")]
    for extra in clutter[1:]:
        del scenario.objects[extra]  # one is enough
    scenario.sleeping = None  # that needs a subsystem `station`
    return scenario


def test_every_name_is_that_of_a_scenario():
    assert set(list_scenarios()) >= {*CONTINUOUS, *ALIKE, *COMPARED}


def test_the_others_are_continuous():
    assert all(is_continuous(load_scenario(name, seed=0)) for name in CONTINUOUS)


@pytest.mark.parametrize("name", DISCRETE)
def test_a_users_own_cell_runs(name):
    result = Simulate(brief(name), record=False, make_cell=own_cell, warm_up=False)
    assert result.log["time"][-1] > 0.1


@pytest.mark.parametrize("name", COMPARED)
def test_a_users_own_cell_behaves_like_ours(name):
    own, ours = (
        Simulate(brief(name), make_cell=make, warm_up=False).log
        for make in (own_cell, MakeCell)
    )
    assert own.keys() == ours.keys()
    for key in ours:
        assert own[key].tobytes() == ours[key].tobytes(), key
    assert own["time"][-1] > 0.1
