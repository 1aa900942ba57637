import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.systems import input_ports, output_ports, takes_nested_plant
from drake_srg.lifetime import my_context
from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate, flat
from drake_srg.simulation.flat import MakeRoot
from drake_srg.station import AddCell, MakeCell


def my_cell(scenario):
    return MakeCell(scenario)


@pytest.fixture
def old_drake(monkeypatch):
    monkeypatch.setattr(flat, "takes_nested_plant", lambda: False)


def test_a_cell_of_your_own_needs_a_newer_drake_for_cenic(old_drake):
    message = (
        r"^kf with a cell of your own needs drake >= 1.58 \(Python 3.12\+\), or "
        r"plant_config.time_step > 0$"
    )
    with pytest.raises(ScenarioError, match=message):
        Simulate(load_scenario("kitchen_fast"), name="kf", make_cell=my_cell)


@pytest.mark.skipif(not takes_nested_plant(), reason="needs drake >= 1.58")
def test_a_cell_of_your_own_runs_on_cenic():
    scenario = load_scenario("kitchen_fast", overrides=["object.present=false"])
    assert Simulate(scenario, make_cell=my_cell).metrics.failure == "not_seen"


def test_a_discrete_cell_is_nested_on_any_drake(old_drake):
    scenario = load_scenario("kitchen")
    builder, cell = MakeRoot("cell", my_cell, None, scenario, "")
    assert builder.Build().GetSubsystemByName("cell") is cell


@pytest.fixture
def flat_cell(old_drake):
    return MakeRoot("cell", MakeCell, AddCell, load_scenario("kitchen_fast"), "")


@pytest.mark.slow
def test_a_flat_root_is_freed(old_drake, leaked):
    scenario = load_scenario("kitchen_fast")
    builder, cell = MakeRoot("cell", MakeCell, AddCell, scenario, "")
    diagram = builder.Build()
    assert len(leaked()) > 4  # otherwise this would test nothing
    del builder, cell, diagram
    assert leaked() == []


def test_a_flat_cell_has_the_ports_of_a_nested_one(flat_cell):
    builder, cell = flat_cell
    nested = MakeCell(load_scenario("kitchen_fast"))
    for _ in ("before", "after"):
        assert output_ports(cell).keys() == output_ports(nested).keys()
        assert input_ports(cell).keys() == input_ports(nested).keys()
        assert cell.HasOutputPort("localizer.blobs")
        assert not cell.HasInputPort("localizer.blobs")
        if not builder.already_built():
            builder.Build()


def test_a_flat_cell_keeps_its_plant_in_the_root(flat_cell):
    builder, cell = flat_cell
    root = builder.Build()
    plant = cell.GetSubsystemByName("station").GetSubsystemByName("plant")
    assert root.GetSubsystemByName("plant") is plant
    assert not root.HasSubsystemNamed("cell")


@pytest.mark.slow
def test_a_flat_cell_is_read_with_the_context_of_the_root(flat_cell):
    builder, cell = flat_cell
    root = builder.Build().CreateDefaultContext()
    state = cell.GetOutputPort("arm.state_measured").Eval(my_context(cell, root))
    nested = MakeCell(load_scenario("kitchen_fast"))
    expected = nested.GetOutputPort("arm.state_measured").Eval(
        nested.CreateDefaultContext()
    )
    np.testing.assert_array_equal(state, expected)
