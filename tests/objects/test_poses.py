import numpy as np
import pytest
from helpers import fix
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.analysis import Simulator

from drake_srg.objects.poses import ContactReader, ObjectPoses
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeStation


def poses_of(bodies, poses):
    system = ObjectPoses({name: BodyIndex(i) for name, i in bodies.items()})
    context = system.CreateDefaultContext()
    fix(system, context, body_poses=AbstractValue.Make(poses))
    return system.get_output_port().Eval(context)


def test_poses_are_given_by_name():
    poses = [RigidTransform([x, 0.0, 0.0]) for x in (0.0, 1.0, 2.0)]
    result = poses_of({"cup": 2, "can": 1}, poses)
    assert result.keys() == {"cup", "can"}
    np.testing.assert_array_equal(result["can"].translation(), [1.0, 0.0, 0.0])
    np.testing.assert_array_equal(result["cup"].translation(), [2.0, 0.0, 0.0])


def test_no_objects_have_no_poses():
    assert poses_of({}, [RigidTransform()]) == {}


def forces(*overrides):
    """Return the contact forces on the can once it has settled on the table [N]."""
    scenario = load_scenario("kitchen", overrides=overrides)
    station = MakeStation(scenario)
    simulator = Simulator(station)
    context = simulator.get_mutable_context()
    home = scenario.arm.home
    station.GetInputPort("arm.position_commanded").FixValue(context, home)
    station.GetInputPort("gripper.closure_commanded").FixValue(context, [0.0])
    simulator.AdvanceTo(0.2)
    contacts = station.GetOutputPort("contact_results_cheat").Eval(context)
    return ContactReader(contacts.plant(), "soup_can").forces(contacts)


@pytest.mark.slow
def test_a_standing_can_presses_on_its_support_with_its_weight():
    found = forces("object.mass=0.4")
    assert found == {"support": pytest.approx(0.4 * 9.81, rel=1e-3)}


@pytest.mark.slow
def test_point_contact_is_read():
    # The can rocks from point to point, so the force varies about its weight.
    found = forces("object.mass=0.4", "plant_config.contact_model=point")
    assert set(found) == {"support"}
    assert 0.1 < found["support"] / (0.4 * 9.81) < 10.0


@pytest.mark.slow
def test_forces_of_other_objects_go_by_their_names():
    found = forces(
        "object.position=[0.6, 0.0]",
        "objects.box={shape: !Box {size: [0.1, 0.1, 0.1]}, mass: 1.0, friction: 0.5, "
        "position: [0.6835, 0.0]}",  # 0.4 mm into the can, which pushes it off
    )
    assert "support" in found
    assert set(found) <= {"support", "box"}


@pytest.mark.slow
def test_the_object_must_be_in_the_plant():
    station = MakeStation(load_scenario("kitchen"))
    with pytest.raises(RuntimeError, match="cup"):
        ContactReader(station.GetSubsystemByName("plant"), "cup")
