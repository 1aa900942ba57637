"""Contacts between arms, and their distance."""

import numpy as np
import pytest
from pydrake.geometry import AddContactMaterial, Box, ProximityProperties, Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder
from station.two_arm_station import two_arms

from drake_srg.common.log_format import MODES, pose_key, pose_to_row
from drake_srg.recording.timeline import Labels, run_timeline
from drake_srg.scenario import load_scenario, robot_arms
from drake_srg.simulation.between_arms import (
    ARM_CONTACT,
    INTERNAL_FORCE,
    InternalForce,
    carried_tilt,
    count_arm_contacts,
    largest_internal_force,
    min_arm_distance,
)
from drake_srg.simulation.measures import arm_states, is_home, safety_stops
from drake_srg.simulation.recorders import recorded_topics, run_labels
from drake_srg.simulation.run_log import RunLog
from drake_srg.station import MakeStation
from drake_srg.types import Mode

STRAIGHT = np.zeros(7)
# Each arm stretched towards the other one: fingers on fingers, then through each other.
TOWARDS = np.array([0.0, 0.5 * np.pi, 0.0, 0.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def scenario():
    scenario = two_arms()
    scenario.cameras.clear()
    return scenario


def log_of(*postures):
    """A log in which the arms take postures (left, right), with open fingers."""
    rest = np.zeros((len(postures), 8))
    log = {"time": 0.1 * np.arange(len(postures))}
    for i, name in enumerate(("left", "right")):
        q = np.array([posture[i] for posture in postures])
        log[f"{name}.state_cheat"] = np.hstack([q, np.zeros_like(q)])
        log[f"{name}.gripper.state_measured"] = rest
    return log


def test_the_least_distance_of_all_samples_counts(scenario):
    far = min_arm_distance(scenario, log_of((STRAIGHT, STRAIGHT)))
    # Upright arms are as far apart as their bases, less the radii of the links.
    assert 0.8 < far < 1.2
    near = min_arm_distance(scenario, log_of((STRAIGHT, STRAIGHT), (TOWARDS, STRAIGHT)))
    assert near < far
    both = min_arm_distance(scenario, log_of((TOWARDS, STRAIGHT), (TOWARDS, TOWARDS)))
    assert both < 0.0  # one arm in the other
    assert min_arm_distance(load_scenario("kitchen_fast"), {}) is None


def test_the_distance_falls_by_how_far_an_arm_moves_on(scenario):
    """No point moves farther than the turn times its distance from the axis."""
    turn, reach = 0.01, 1.4
    first, second = (
        min_arm_distance(scenario, log_of(([0.0, 0.6 + a, *np.zeros(5)], STRAIGHT)))
        for a in (0.0, turn)
    )
    assert 0.0 < first - second < turn * reach


def test_contacts_are_counted_by_their_beginnings():
    force = np.array([1.0, 1.0, 0.0, 0.0, 2.0, 0.0, 3.0, 4.0])
    assert count_arm_contacts({ARM_CONTACT: force}) == 3
    assert count_arm_contacts({ARM_CONTACT: np.zeros(4)}) == 0
    assert count_arm_contacts({}) is None


def test_contact_forces_between_arms_are_logged():
    scenario = two_arms()
    scenario.cameras.clear()
    scenario.arms["left"].arm.home = scenario.arms["right"].arm.home = [*TOWARDS]
    station = MakeStation(scenario)
    context = station.CreateDefaultContext()
    for name in ("left", "right"):
        station.GetInputPort(f"{name}.position_commanded").FixValue(context, TOWARDS)
        station.GetInputPort(f"{name}.gripper.closure_commanded").FixValue(context, 0.0)
    log = RunLog(scenario, station)
    log.sample(context)
    plant = station.GetSubsystemByName("plant")
    away = plant.GetMyMutableContextFromRoot(context)
    plant.SetPositions(away, plant.GetModelInstanceByName("left"), STRAIGHT)
    context.SetTime(0.1)
    log.sample(context)
    arrays = log.arrays()
    assert arrays[ARM_CONTACT][0] > 0.0
    assert arrays[ARM_CONTACT][1] == 0.0
    assert arrays["left.state_cheat"].shape == (2, 14)
    assert arrays["right.gripper.grasped"].shape[0] == 2


def pressed_ball(along):
    """Contact results of a ball between two walls that overlap it, moved along y."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    properties = ProximityProperties()
    AddContactMaterial(10.0, 1e5, CoulombFriction(0.5, 0.5), properties)
    poses = {"left": [0.0, -0.099, 0.0], "right": [0.0, 0.099, 0.0], "ball": [0.0] * 3}
    for name, p in poses.items():
        model = plant.AddModelInstance(name)
        body = plant.AddRigidBody(name, model, SpatialInertia.SolidSphereWithMass(1, 1))
        shape = Sphere(0.05) if name == "ball" else Box(0.1, 0.1, 0.1)
        plant.RegisterCollisionGeometry(body, RigidTransform(), shape, name, properties)
        if name != "ball":
            plant.WeldFrames(plant.world_frame(), body.body_frame(), RigidTransform(p))
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    own = plant.GetMyMutableContextFromRoot(context)
    ball = plant.GetBodyByName("ball")
    plant.SetFreeBodyPose(own, ball, RigidTransform([0.0, along, 0.0]))
    return plant, plant.get_contact_results_output_port().Eval(own)


@pytest.mark.parametrize("along", [0.0, 5e-4, -3e-4])
def test_the_internal_force_is_what_cancels_out(along):
    plant, results = pressed_ball(along)
    forces = sorted(
        float(np.linalg.norm(results.point_pair_contact_info(i).contact_force()))
        for i in range(results.num_point_pair_contacts())
    )
    assert len(forces) == 2
    for hands in (("left", "right"), ("right", "left")):
        inner = InternalForce(plant, "ball", hands).force(results)
        assert inner == pytest.approx(np.mean(forces))


def test_one_hand_alone_has_no_internal_force():
    plant, results = pressed_ball(0.0015)  # it has left the other wall
    assert results.num_point_pair_contacts() == 1
    assert InternalForce(plant, "ball", ("left", "right")).force(results) == 0.0


def test_the_tilt_counts_while_the_object_is_carried():
    tilts = [0.5, 0.01, 0.02, 0.3]
    modes = [Mode.CLOSE, Mode.LIFT, Mode.TRANSFER, Mode.RELEASE]
    log = {
        INTERNAL_FORCE: np.array([0.0, -7.0, 3.0, 1.0]),
        "mode": np.array([MODES.index(mode) for mode in modes]),
        pose_key("crate"): np.array(
            [
                pose_to_row(RigidTransform(RollPitchYaw(tilt, 0.0, 1.0), np.zeros(3)))
                for tilt in tilts
            ]
        ),
    }
    assert largest_internal_force(log) == 7.0
    assert carried_tilt(log, "crate") == pytest.approx(np.rad2deg(0.02))
    assert carried_tilt({**log, "mode": np.zeros(4)}, "crate") is None
    assert largest_internal_force({}) is None
    assert carried_tilt({}, "crate") is None


def test_states_of_several_arms_are_one_vector(scenario):
    arms = robot_arms(scenario)
    log = log_of((TOWARDS, STRAIGHT))
    log["left.state_cheat"][:, 7:] = 1.0
    states = arm_states(log, arms)
    np.testing.assert_array_equal(
        states[0], [*TOWARDS, *STRAIGHT, *np.ones(7), *np.zeros(7)]
    )
    homes = [np.array(arm.arm.home) for arm in arms]
    assert is_home(scenario, log_of(homes))
    assert not is_home(scenario, log_of((homes[0], homes[1] + 0.05)))


def test_stops_name_their_arm(scenario):
    state = np.zeros((3, 2))
    state[1:, 0] = 1.0
    log = {"time": np.arange(3.0), "right.safety.state": state}
    (stop,) = safety_stops(log, robot_arms(scenario))
    assert stop["time_s"] == 1.0
    assert stop["arm"] == "right"


def test_recordings_know_the_arms_by_name(scenario):
    topics = {
        topic.name: topic for topic in recorded_topics(MakeStation(scenario), scenario)
    }
    states = topics["/joint_states"]
    assert {
        "left.state_measured",
        "right.gripper.state_measured",
    } <= states.ports.keys()
    values = [np.zeros(size) for size in states.ports.values()]
    message = states.convert(lambda kind, *_, **fields: fields, 0.0, *values)
    assert len(set(message["name"])) == len(message["name"]) == 22
    assert {"left_joint_1", "right_left_base_joint"} <= set(message["name"])
    assert {"/left/gripper/proximity", "/right/gripper/contact_force"} <= topics.keys()
    labels = run_labels("mine", scenario)
    assert Labels.of_tree(labels.tree()) == labels
    timeline = run_timeline(log_of((STRAIGHT, TOWARDS)) | modes(1), labels)
    words = [label.replace("\n", " ") for label, _, _ in timeline.panels]
    assert "left finger joints [deg]" in words
    assert "right finger joints [deg]" in words


def modes(count):
    return {"mode": np.zeros(count)}
