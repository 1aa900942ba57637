import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from drake_srg.objects.config import ObjectConfig, SoftConfig
from drake_srg.recording.replay.glb import EXTRAS, write_glb
from drake_srg.recording.replay.recorder import ReplayRecorder
from drake_srg.recording.replay.scene import (
    METERS_PER_NEWTON,
    SceneRecorder,
    force_node,
    pose_row,
    pose_tracks,
)
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Box
from recording.replay.strict_reader import Strict
from recording.replay.tiny_scene import PERIOD, SAMPLES, record


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("tiny")


@pytest.fixture(scope="module")
def poses(folder):
    return record(folder)


@pytest.fixture(scope="module")
def strict(folder, poses):
    return Strict((folder / "replay.glb").read_bytes())


@pytest.mark.parametrize("name", ["box::body", "swing::bar"])
def test_every_pose_is_the_plants(strict, poses, name):
    tracks = {path: strict.track(name, path) for path in ("translation", "rotation")}
    p = np.array([X.translation() for X in poses[name]])
    for path, exact in (("translation", p), ("rotation", rotations(poses[name]))):
        if tracks[path] is None:
            values = np.tile(strict.node(name)[1][path], (SAMPLES, 1))
        else:
            time, values = tracks[path]
            np.testing.assert_allclose(time, PERIOD * np.arange(SAMPLES), atol=1e-6)
        signs = np.sign(np.sum(values * exact, axis=1))[:, None]
        signs = signs if path == "rotation" else 1
        np.testing.assert_allclose(values * signs, exact, atol=1e-6)


def rotations(poses):
    wxyz = np.array([X.rotation().ToQuaternion().wxyz() for X in poses])
    return np.roll(wxyz, -1, axis=1)


def test_the_file_has_labels_and_the_place_of_the_video(strict):
    extras = strict.document["scenes"][0]["extras"][EXTRAS]
    assert extras["labels"]["title"] == "tiny, seed 0"
    assert (extras["video_camera"], extras["video_start"]) == ("side", 0.05)


def test_a_force_carries_the_box_after_its_fall(strict):
    name = "force of world on box::body"
    _, shift = strict.track(name, "translation")
    _, scale = strict.track(name, "scale")
    assert scale[0, 2] == 0  # in the air
    weight = 9.81 * METERS_PER_NEWTON
    assert scale[-1, 2] == pytest.approx(weight, rel=0.7)  # it still rocks
    assert shift[-1, 2] == pytest.approx(0, abs=0.01)  # on the floor


def test_a_camera_looks_as_drakes(strict):
    node = strict.node("side")[1]
    camera = strict.document["cameras"][node["camera"]]["perspective"]
    assert camera["aspectRatio"] == pytest.approx(64 / 48)
    assert camera["yfov"] == pytest.approx(0.8)
    assert node["translation"] == pytest.approx([0.2, -2.0, 1.2])
    x, y, z, w = node["rotation"]
    looks = -np.array([2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x**2 + y**2)])
    # Towards y and down, by a roll of -2 rad of an axis that looked up.
    np.testing.assert_allclose(looks, [0, np.sin(2), np.cos(2)], atol=1e-6)


def test_equal_runs_give_equal_bytes(folder, poses, tmp_path):
    record(tmp_path)
    first, second = (f / "replay.glb" for f in (folder, tmp_path))
    assert first.read_bytes() == second.read_bytes()


def test_without_contact_results_there_are_no_forces(tmp_path):
    record(tmp_path, contacts=False)
    strict = Strict((tmp_path / "replay.glb").read_bytes())
    names = [node["name"] for node in strict.document["nodes"]]
    assert names == ["world", "box::body", "swing::bar", "side", "world (z up)"]


def test_a_diagram_without_a_scene_is_refused():
    builder = DiagramBuilder()
    builder.AddSystem(ConstantVectorSource([0.0]))
    diagram = builder.Build()
    with pytest.raises(ValueError, match="SceneGraph"):
        ReplayRecorder(diagram, diagram)


@pytest.mark.slow
def test_a_soft_body_has_the_vertices_of_the_plant():
    """Its pose and the shapes that it morphs into give every vertex that is seen."""
    soft = SoftConfig(youngs_modulus=3e3)
    sponge = ObjectConfig(
        shape=Box([0.04, 0.06, 0.05]),
        soft=soft,
        mass=0.1,
        friction=0.6,
        resolution=0.03,
    )
    scenario = bench_scenario(sponge, overrides=["plant_config.time_step=0.005"])
    exact = []
    with Rig(scenario) as rig:
        graph = rig.station.GetSubsystemByName("scene_graph")
        recorder = SceneRecorder(graph, objects=["thing"])
        deformables = rig.plant.deformable_model()
        model = rig.plant.GetModelInstanceByName("thing")
        (body,) = map(deformables.GetBody, deformables.GetBodyIds(model))
        for _ in range(8):
            rig.advance(0.02)
            contacts = rig.station.GetOutputPort("contact_results_cheat").Eval(
                rig.station.GetMyContextFromRoot(rig.context)
            )
            query = graph.get_query_output_port().Eval(
                graph.GetMyContextFromRoot(rig.context)
            )
            recorder.sample(rig.context.get_time(), query, contacts)
            exact.append(body.GetPositions(rig.plant_context).T)
    nodes = recorder.nodes()
    Strict(write_glb(nodes, {}))
    (node,) = (n for n in nodes if n.parts and n.parts[0].targets)
    surface, targets = node.parts[0].surface, node.parts[0].targets
    assert np.abs(exact[-1] - exact[0]).max() > 1e-3  # it yields
    for k, vertices in enumerate(exact):
        weights = node.tracks["weights"].values[k]
        shape = surface.points + np.tensordot(weights, targets, 1)
        x, y, z, w = node.tracks["rotation"].values[k]
        p_WO = node.tracks["translation"].values[k]
        points = (RigidTransform(Quaternion(w, x, y, z), p_WO) @ shape.T).T
        apart = np.linalg.norm(points[:, None] - vertices, axis=2)
        assert apart.min(axis=1).max() < 1e-5
    assert any(n.extras and n.extras.get("force") for n in nodes)


TIME = np.arange(6) / 50
# Contact in the samples 1, 2 and 4.
CONTACTS = [
    (1, np.array([0.1, 0.2, 0.3, 0.0, 0.0, 2.0])),
    (2, np.array([0.1, 0.2, 0.4, 0.0, 3.0, 0.0])),
    (4, np.array([0.5, 0.2, 0.4, 0.0, 0.0, -4.0])),
]


def at(track, time):
    """Return a track's value at one of its sample times, held where it has none."""
    return np.array([np.interp(time, track.time, column) for column in track.values.T])


def test_an_arrow_has_the_forces_place_direction_and_size():
    node = force_node(("table", "can"), CONTACTS, TIME)
    assert node.name == "force of table on can"
    for i, row in CONTACTS:
        scale = at(node.tracks["scale"], TIME[i])
        force = np.linalg.norm(row[3:])
        np.testing.assert_allclose(scale, [1, 1, METERS_PER_NEWTON * force])
        np.testing.assert_allclose(at(node.tracks["translation"], TIME[i]), row[:3])
        x, y, z, w = at(node.tracks["rotation"], TIME[i])
        direction = RigidTransform(Quaternion(w, x, y, z), [0, 0, 0]) @ [0, 0, 1]
        np.testing.assert_allclose(direction, row[3:] / force, atol=1e-12)


def test_without_contact_an_arrow_has_no_size():
    node = force_node(("table", "can"), CONTACTS, TIME)
    for i in (0, 3, 5):
        np.testing.assert_array_equal(at(node.tracks["scale"], TIME[i]), [0, 0, 0])
    Strict(write_glb([node], {}))


def test_a_steady_force_needs_two_samples_at_most():
    samples = [(i, CONTACTS[0][1]) for i in range(len(TIME))]
    node = force_node(("table", "can"), samples, TIME)
    assert all(len(track.time) <= 2 for track in node.tracks.values())


@given(st.tuples(*3 * [st.floats(-3, 3)]))
def test_a_pose_is_kept(angles):
    X = RigidTransform(RollPitchYaw(*angles), [1.0, 2.0, 3.0])
    tracks = pose_tracks(TIME[:1], pose_row(X)[None])
    x, y, z, w = tracks["rotation"].values[0]
    again = RigidTransform(Quaternion(w, x, y, z), tracks["translation"].values[0])
    assert again.IsNearlyEqualTo(X, 1e-12)
    assert np.linalg.norm([x, y, z, w]) == pytest.approx(1)
