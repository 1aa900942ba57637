import dataclasses as dc

import pytest
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from drake_srg.objects.models import object_body
from drake_srg.scenario import load_scenario
from drake_srg.scenario.schema import ClearConfig
from drake_srg.simulation.measures import AT_REST
from drake_srg.simulation.run_log import RunLog, merged
from simulation.own_cells import RaisingPort, cell_with


@pytest.fixture(scope="module")
def scenario():
    scenario = load_scenario("gripper_bench")
    scenario.cameras.clear()
    return scenario


@pytest.fixture(scope="module")
def cell(scenario):
    """A cell with a port `gripper.fuse`, which cannot be evaluated from 0.2 s on."""
    return cell_with(RaisingPort(ZeroDivisionError, 0.2))(scenario)


def test_an_exception_adds_no_row(scenario, cell):
    log, context = RunLog(scenario, cell), cell.CreateDefaultContext()
    assert not log
    log.sample(context)
    context.SetTime(0.2)
    with pytest.raises(ZeroDivisionError):
        log.sample(context)
    assert len(log) == 1
    assert {len(array) for array in log.arrays().values()} == {1}


def test_the_log_has_the_arms_ports_and_most_of_the_grippers(scenario, cell):
    log = RunLog(scenario, cell)
    log.sample(cell.CreateDefaultContext())
    assert log.arrays().keys() == {
        "time",
        "mode",
        "arm.state_measured",
        "arm.state_cheat",
        "arm.torque_measured",
        "arm.position_commanded",
        "gripper.state_measured",
        "gripper.closure_commanded",
        "gripper.pwm",
        "gripper.proximity",
        "gripper.grasped",
        "gripper.fuse",
        "object_pose.soup_can",
        "contact_force",
    }


def test_the_latest_sample_tells_what_touches_the_picked_object(scenario, cell):
    simulator = Simulator(cell)
    log = RunLog(scenario, cell)
    assert log.touching == set()
    simulator.AdvanceTo(0.1)
    log.sample(simulator.get_context())
    assert log.touching == {"support"}
    assert log.arrays()["contact_force"] == [0.0]  # of the gripper


@pytest.mark.parametrize("speed", [0.0, 0.002, 0.02])
def test_tells_whether_what_is_to_be_cleared_still_moves(scenario, cell, speed):
    task = dc.replace(scenario.task, clear=ClearConfig(objects=["soup_can", "absent"]))
    log = RunLog(dc.replace(scenario, task=task), cell)
    station = cell.GetSubsystemByName("inner").GetSubsystemByName("station")
    plant = station.GetSubsystemByName("plant")
    context = cell.CreateDefaultContext()
    model = plant.GetModelInstanceByName("soup_can")
    body = plant.get_body(object_body(plant, model))
    for time in (0.0, 0.05, 0.1, 0.15):
        context.SetTime(time)
        log.sample(context)
        X_WO = RigidTransform([speed * time, 0.0, 0.0])
        plant.SetFreeBodyPose(plant.GetMyMutableContextFromRoot(context), body, X_WO)
    assert log.clearing_moves == (speed > AT_REST)


def test_of_several_grippers_the_largest_force_counts():
    found = merged([{"support": 1.0, "a": 2.0}, {"support": 3.0}])
    assert found == {"support": 3.0, "a": 2.0}
