import pytest
from pydrake.systems.analysis import Simulator

from drake_srg.scenario import load_scenario
from drake_srg.simulation.run_log import RunLog
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
