import numpy as np
import pytest
from helpers import fix
from pydrake.common.value import AbstractValue
from pydrake.geometry import Box, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import BodyIndex, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.objects.poses import ContactReader, ObjectPoses, PeakForce
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


def peak_force(height, names=("ball", "floor"), duration=0.5):
    """Return the peak force between a ball of 1 kg and a floor it is dropped on [N]."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.001)
    shapes = {"ball": Sphere(0.05), "floor": Box(1.0, 1.0, 0.1)}
    for name, shape in shapes.items():
        body = plant.AddRigidBody(
            name,
            plant.AddModelInstance(name),
            SpatialInertia.SolidSphereWithMass(1.0, 0.05),
        )
        friction = CoulombFriction(0.5, 0.5)
        X_BG = RigidTransform()
        plant.RegisterCollisionGeometry(body, X_BG, shape, name, friction)
    X_WF = RigidTransform([0.0, 0.0, -0.05])
    floor = plant.GetFrameByName("floor")
    plant.WeldFrames(plant.world_frame(), floor, X_WF)
    plant.Finalize()
    X_WB = RigidTransform([0.0, 0.0, 0.05 + height])
    plant.SetDefaultFloatingBaseBodyPose(plant.GetBodyByName("ball"), X_WB)
    force = builder.AddSystem(PeakForce(plant, names, 0.001))
    builder.Connect(plant.get_contact_results_output_port(), force.get_input_port())
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(duration)
    context = force.GetMyContextFromRoot(simulator.get_context())
    return force.get_output_port().Eval(context)[0]


def test_the_peak_force_outlasts_the_impact():
    at_rest, dropped = peak_force(0.0), peak_force(0.05)
    assert 9.8 < at_rest < 2.2 * 9.81  # it sinks in by itself, and may swing
    assert dropped > 3.0 * at_rest
    assert peak_force(0.05, duration=1.0) == dropped
    assert peak_force(0.05, ("floor", "ball")) == dropped


def test_there_is_no_force_without_contact():
    assert peak_force(1.0, duration=0.1) == 0.0
