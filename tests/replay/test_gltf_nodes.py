import numpy as np
import pytest
from pydrake.geometry import Box, Sphere

from drake_srg.replay.glb import Node, Part, Track, read_glb, write_glb
from drake_srg.replay.gltf_nodes import read_nodes
from drake_srg.replay.rrd import at_times
from drake_srg.replay.triangles import shape_triangles
from replay.tiny_scene import PERIOD, record

TIME = np.array([0.0, 0.5, 1.0])


def read(nodes):
    return read_nodes(*read_glb(write_glb(nodes, {})))


def close(first, second):
    np.testing.assert_allclose(first, second, atol=1e-6)


def test_what_was_written_is_read():
    cube = shape_triangles(Box(1, 2, 3))
    ball = shape_triangles(Sphere(0.5))
    bulge = Part(ball, (0.8, 0.1, 0.08, 1.0), [0.1 * ball.normals, 0.2 * ball.points])
    tracks = {
        "translation": Track(TIME, np.array([[0.0, 0, 1], [0, 1, 1], [0, 2, 1]])),
        "rotation": Track(TIME, np.tile([0.0, 0.0, 0.0, 1.0], (3, 1))),
        "weights": Track(TIME, np.array([[0.0, 1], [1, 0], [0.5, 0.5]])),
    }
    camera = {"yfov": 0.8, "aspectRatio": 1.5, "znear": 0.01, "zfar": 10.0}
    nodes = [
        Node("soft", [bulge], tracks),
        Node("still", [Part(cube, (0.1, 0.2, 0.3, 0.4)), bulge], {}),
        Node("eye", camera=camera, extras={"camera": "eye"}),
    ]
    found = read(nodes)
    assert [node.name for node in found] == ["soft", "still", "eye"]
    for path in ("translation", "weights"):
        track = found[0].tracks[path]
        close(track.time, TIME)
        close(track.values, tracks[path].values)
    close(found[0].tracks["rotation"].values, [[0, 0, 0, 1]])  # does not change
    for node, original in zip(found, nodes, strict=True):
        for part, other in zip(node.parts, original.parts, strict=True):
            close(part.surface.points, other.surface.points)
            np.testing.assert_allclose(part.color, other.color, atol=1e-3)
            np.testing.assert_array_equal(part.surface.faces, other.surface.faces)
            for target, same in zip(part.targets, other.targets, strict=True):
                close(target, same)
    assert (found[2].camera, found[2].extras) == (camera, {"camera": "eye"})
    assert found[0].camera is None and found[0].extras is None


def test_poses_are_those_of_the_simulation(tmp_path):
    poses = record(tmp_path)
    scene = read_glb((tmp_path / "replay.glb").read_bytes())
    nodes = {node.name: node for node in read_nodes(*scene)}
    for name, expected in poses.items():
        time = PERIOD * np.arange(len(expected)) + 1e-6  # the file's are float32
        p = at_times(nodes[name].tracks["translation"], time)
        close(p, [X.translation() for X in expected])
        q = at_times(nodes[name].tracks["rotation"], time)[:, [3, 0, 1, 2]]
        other = np.array([X.rotation().ToQuaternion().wxyz() for X in expected])
        close(np.abs(np.sum(q * other, axis=1)), 1.0)


def test_another_scene_is_refused():
    document, binary = read_glb(write_glb([], {}))
    with pytest.raises(ValueError, match="not a scene of ours: KeyError"):
        read_nodes({**document, "nodes": [{}]}, binary)
