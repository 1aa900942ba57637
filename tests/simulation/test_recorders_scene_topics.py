"""The 3D scene in recording.mcap, as Foxglove and RViz read it."""

import numpy as np
import pytest
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from drake_srg.scenario import load_scenario
from drake_srg.simulation.recorders import AddRosbagRecorder, scene_topics
from drake_srg.station import MakeStation

SCENARIO = load_scenario("gripper_bench")


def record(scenario, out):
    """Record 0.1 s of a station, and return its plant and the plant's last state."""
    builder = DiagramBuilder()
    station = builder.AddNamedSystem("station", MakeStation(scenario))
    topics = scene_topics(station, scenario)
    with AddRosbagRecorder(builder, station, scenario, out, topics):
        simulator = Simulator(builder.Build())
        context = station.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        for name in ("arm.position_commanded", "gripper.closure_commanded"):
            port = station.GetInputPort(name)
            port.FixValue(context, np.zeros(port.size()))
        simulator.AdvanceTo(0.1)
        plant = station.GetSubsystemByName("plant")
        return {
            body.scoped_name().get_full(): plant.EvalBodyPoseInWorld(
                plant.GetMyContextFromRoot(simulator.get_context()), body
            )
            for body in bodies(plant)
        }


def bodies(plant: MultibodyPlant):
    for instance in ("arm", "gripper", "can"):
        if plant.HasModelInstanceNamed(instance):
            for index in plant.GetBodyIndices(plant.GetModelInstanceByName(instance)):
                yield plant.get_body(index)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Poses at the end, and the messages, read by the file's own definitions."""
    out = tmp_path_factory.mktemp("scene")
    poses = record(SCENARIO, out)
    store, found = get_typestore(Stores.EMPTY), {}
    with Reader(out / "recording.mcap") as reader:
        for connection in reader.connections:
            types = get_types_from_msg(connection.msgdef.data, connection.msgtype)
            new = {k: v for k, v in types.items() if k not in store.types}
            store.register(new)
        for connection, _, data in reader.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            found.setdefault(connection.topic, []).append(message)
    return poses, found


def test_transforms_are_the_poses_of_the_moving_bodies(recorded):
    poses, found = recorded
    transforms = found["/tf"][-1].transforms
    names = [each.child_frame_id for each in transforms]
    assert len(set(names)) == len(names)
    assert {"gripper/left_tip_link", "gripper/palm"} <= set(names)
    for each in transforms:
        assert each.header.frame_id == "world"
        p, q = each.transform.translation, each.transform.rotation
        wxyz = np.array([q.w, q.x, q.y, q.z])
        X_WB = RigidTransform(Quaternion(wxyz / np.linalg.norm(wxyz)), [p.x, p.y, p.z])
        expected = poses.get(each.child_frame_id.replace("/", "::"))
        if expected is not None:
            assert X_WB.IsNearlyEqualTo(expected, 1e-6), each.child_frame_id


def test_transforms_come_at_the_rate_of_the_log(recorded):
    _, found = recorded
    assert len(found["/tf"]) == pytest.approx(0.1 / SCENARIO.recording.period, abs=1)
    assert len(found["/tf"]) == len(found["/joint_states"])


def test_the_scene_comes_once_and_every_marker_has_a_frame(recorded):
    _, found = recorded
    (scene,) = found["/scene"]
    frames = {each.child_frame_id for each in found["/tf"][0].transforms}
    assert {marker.header.frame_id for marker in scene.markers} == {"world", *frames}
    keys = [(marker.ns, marker.id) for marker in scene.markers]
    assert len(set(keys)) == len(keys)
    for marker in scene.markers:
        assert marker.type == marker.TRIANGLE_LIST
        assert len(marker.points) % 3 == 0
        assert marker.points
        assert marker.frame_locked
        assert 0.0 < marker.color.a <= 1.0


def test_markers_are_as_large_as_their_bodies(recorded):
    _, found = recorded
    pads = [m for m in found["/scene"][0].markers if m.ns == "gripper/left_tip_link"]
    points = np.array([[p.x, p.y, p.z] for m in pads for p in m.points])
    assert np.ptp(points, axis=0).max() == pytest.approx(0.0588 + 0.007, abs=0.02)


def test_a_station_without_the_state_of_the_scenario_has_no_scene():
    other = load_scenario("assistive_arm")
    assert scene_topics(MakeStation(SCENARIO), other) == []
