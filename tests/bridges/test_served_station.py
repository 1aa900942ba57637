import numpy as np
import pytest

from drake_srg.bridges.served_station import MakeServedStation
from drake_srg.common.ports import input_ports, output_ports
from drake_srg.scenario import load_scenario

SCENARIO = load_scenario("kitchen")


@pytest.fixture(scope="module")
def station():
    return MakeServedStation(SCENARIO)


def test_the_arm_takes_targets_instead_of_commands(station):
    assert "arm.position_desired" in input_ports(station)
    assert "arm.position_commanded" not in input_ports(station)


def test_it_has_the_station_s_ports_without_the_cameras(station):
    inner = station.GetSubsystemByName("station")
    assert set(input_ports(inner)) - {"arm.position_commanded"} == (
        set(input_ports(station)) - {"arm.position_desired"}
    )
    assert set(output_ports(station)) - set(output_ports(inner)) == {
        "arm.position_commanded",
        "gripper.closure_commanded",
    }
    assert not [name for name in output_ports(station) if name.startswith("camera_")]


def test_the_commanded_arm_starts_at_home(station):
    context = station.CreateDefaultContext()
    port = station.GetOutputPort("arm.position_commanded")
    np.testing.assert_allclose(port.Eval(context), SCENARIO.arm.home)


def test_the_closure_is_shown_as_commanded(station):
    context = station.CreateDefaultContext()
    station.GetInputPort("gripper.closure_commanded").FixValue(context, [0.3])
    port = station.GetOutputPort("gripper.closure_commanded")
    assert port.Eval(context) == [0.3]
