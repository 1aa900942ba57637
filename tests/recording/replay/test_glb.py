import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.geometry import Box, Sphere

from drake_srg.recording.replay.glb import (
    EXTRAS,
    Node,
    Part,
    Track,
    read_glb,
    write_glb,
)
from drake_srg.recording.replay.triangles import shape_triangles
from recording.replay.strict_reader import Strict

RED = (0.8, 0.1, 0.08, 1.0)
CUBE = Part(shape_triangles(Box(1, 2, 3)), RED)
TIME = np.array([0.0, 0.5, 1.0])
ANGLE = np.array([0.0, 2.0, 4.0])  # the quaternion's sign changes on the way
TURN = np.stack([0 * ANGLE, 0 * ANGLE, np.sin(ANGLE / 2), np.cos(ANGLE / 2)], axis=1)
SHIFT = np.array([[0.0, 0, 1], [0, 1, 1], [0, 2, 1]])


def moving(name="moving", turn=TURN, shift=SHIFT):
    tracks = {"translation": Track(TIME, shift), "rotation": Track(TIME, turn)}
    return Node(name, [CUBE], tracks)


def test_a_scene_follows_the_specification():
    camera = {"yfov": 0.8, "aspectRatio": 1.5, "znear": 0.01, "zfar": 10.0}
    clear = Part(shape_triangles(Sphere(0.5)), (0.1, 0.2, 0.3, 0.4))
    nodes = [moving(), Node("still", [CUBE, clear]), Node("camera", camera=camera)]
    strict = Strict(write_glb(nodes, {"answer": 42}))
    assert strict.document["scenes"][0]["extras"] == {EXTRAS: {"answer": 42}}
    assert strict.document["cameras"][0]["perspective"] == camera
    modes = [m.get("alphaMode", "OPAQUE") for m in strict.document["materials"]]
    assert modes == ["OPAQUE", "BLEND"]
    time, values = strict.track("moving", "translation")
    np.testing.assert_array_equal(time, TIME.astype(np.float32))
    np.testing.assert_array_equal(values, SHIFT)


def test_neighbouring_quaternions_have_the_same_sign():
    jumping = TURN * [[1], [-1], [1]]
    _, values = Strict(write_glb([moving(turn=jumping)], {})).track(
        "moving", "rotation"
    )
    np.testing.assert_allclose(values, TURN, atol=1e-6)


def test_what_stands_still_is_not_animated():
    still = np.tile([1.0, 2.0, 3.0], (3, 1))
    strict = Strict(write_glb([moving(shift=still)], {}))
    assert strict.track("moving", "translation") is None
    assert strict.track("moving", "rotation") is not None
    assert strict.node("moving")[1]["translation"] == [1, 2, 3]
    assert "animations" not in read_glb(write_glb([Node("still", [CUBE])], {}))[0]


def test_equal_arrays_are_stored_once():
    one, two = ([moving(str(i)) for i in range(n)] for n in (1, 2))
    assert len(read_glb(write_glb(one, {}))[1]) == len(read_glb(write_glb(two, {}))[1])


def test_equal_scenes_give_equal_bytes():
    assert write_glb([moving()], {"a": 1}) == write_glb([moving()], {"a": 1})


def test_images_are_inside_in_their_order():
    images = [b"first", b"second one", b"first"]
    document, binary = read_glb(write_glb([], {}, images))
    views = [document["bufferViews"][i["bufferView"]] for i in document["images"]]
    data = [binary[v["byteOffset"] :][: v["byteLength"]] for v in views]
    assert data == images


def test_another_reader_finds_the_same_scene():
    """trimesh turns z up into y up, as every viewer does."""
    import trimesh

    scene = trimesh.load(io.BytesIO(write_glb([moving()], {})), file_type="glb")
    (mesh,) = scene.geometry.values()
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [1, 2, 3])
    assert mesh.volume == pytest.approx(6)
    np.testing.assert_allclose(np.ptp(scene.bounds, axis=0), [1, 3, 2], atol=1e-6)
    np.testing.assert_allclose(scene.bounds.mean(axis=0), [0, 1, 0], atol=1e-6)


DATA = write_glb([moving()], {})


@given(st.integers(0, len(DATA) - 1))
def test_a_file_that_is_cut_off_is_refused(size):
    with pytest.raises(ValueError, match="GLB"):
        read_glb(DATA[:size])


@given(st.binary(max_size=200))
def test_other_files_are_refused(data):
    with pytest.raises(ValueError, match="GLB"):
        read_glb(data)
