import sys

import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.meshes.mesh_file import describe_openness, read_mesh
from objects.meshes.made_meshes import FACES, box, joined, write_obj, write_stl

ONE = np.ones(3)


def read(path, scale=ONE):
    warnings = []
    return read_mesh(path, scale, warnings), warnings


@pytest.mark.parametrize("write", [write_obj, write_stl])
def test_a_closed_box_needs_no_mending(tmp_path, write):
    path = write(tmp_path / f"box.{write.__name__[-3:]}", box([0.04, 0.05, 0.06]))
    ((mesh, color),), warnings = read(path)
    assert mesh.volume == pytest.approx(0.04 * 0.05 * 0.06)
    assert (color, warnings, describe_openness(mesh)) == (None, [], "")


def test_gltf_points_up_along_y(tmp_path):
    trimesh = pytest.importorskip("trimesh")  # of the extra `import`
    path = tmp_path / "box.glb"
    trimesh.Trimesh(*box([0.04, 0.05, 0.06], at=[0, 0.025, 0])).export(path)
    ((mesh, _),), _ = read(path)
    np.testing.assert_allclose(mesh.bounds[:, 2], [0.0, 0.05], atol=1e-9)


def test_an_obj_has_the_colour_of_its_material(tmp_path):
    (tmp_path / "red.mtl").write_text("newmtl red\nKd 0.8 0.2 0.1\n")
    path = tmp_path / "box.obj"
    write_obj(path, box([0.04] * 3), head="mtllib red.mtl\nusemtl red")
    ((_, color),), _ = read(path)
    assert color == pytest.approx((0.8, 0.2, 0.1), abs=0.01)


def test_faces_that_point_inwards_are_turned(tmp_path):
    vertices, faces = box([0.04] * 3)
    ((mesh, _),), warnings = read(
        write_obj(tmp_path / "a.obj", (vertices, faces[:, ::-1]))
    )
    assert mesh.volume == pytest.approx(0.04**3)
    assert "pointed inwards" in warnings[0]


def test_a_mirrored_mesh_is_not_inside_out(tmp_path):
    path = write_obj(tmp_path / "a.obj", box([0.04, 0.05, 0.06]))
    ((mesh, _),), warnings = read(path, np.array([1.0, -1.0, 1.0]))
    assert mesh.volume == pytest.approx(0.04 * 0.05 * 0.06)
    assert warnings == []


def test_a_hollow_stays_hollow(tmp_path):
    inner, faces = box([0.02] * 3)
    mesh = joined(box([0.04] * 3), (inner, faces[:, ::-1]))
    ((mesh, _),), warnings = read(write_obj(tmp_path / "a.obj", mesh))
    assert mesh.volume == pytest.approx(0.04**3 - 0.02**3)
    assert warnings == []


def test_an_open_mesh_says_where(tmp_path):
    vertices, faces = box([0.04] * 3)
    ((mesh, _),), _ = read(write_obj(tmp_path / "a.obj", (vertices, faces[2:])))
    text = describe_openness(mesh)
    assert text.startswith("open at 4 edges")
    assert "-0.02" in text  # the missing face is at x = -0.02


def test_faces_that_disagree_are_told(tmp_path):
    vertices, faces = box([0.04] * 3)
    faces = np.vstack([faces[:1, ::-1], faces[1:]])
    ((mesh, _),), _ = read(write_obj(tmp_path / "a.obj", (vertices, faces)))
    assert "disagree" in describe_openness(mesh)


NAN = "v 0 0 0\nv 0 nan 0\nv 0 1 0\nv 1 0 0\nf 1 2 3\nf 1 2 4\n"
FLAT = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n"
LINE = "v 0 0 0\nv 0.1 0 0\nv 0.2 0 0\nf 1 2 3\n"
BAD_INDEX = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 9\n"


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("a.obj", NAN, "1 of 4 vertices are not finite, the first is vertex 1"),
        ("a.obj", "", "no triangles"),
        ("a.obj", "v 0 0 0\n", "no triangles"),
        ("a.obj", FLAT, "is flat"),
        ("a.obj", LINE, "only triangles without area"),
        ("a.obj", BAD_INDEX, "cannot be read as a mesh"),
        ("a.stl", "hello", "no triangles"),
        ("a.glb", "hello", "cannot be read as a mesh"),
        ("a.ply", "hello", r"unknown format \(allowed: .sdf, .urdf, .obj"),
    ],
)
def test_what_is_not_a_mesh_is_refused(tmp_path, name, content, problem):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(ScenarioError, match=rf"{name}: .*{problem}"):
        read(path)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(ScenarioError, match=r"none\.obj: cannot be read: no such file"):
        read(tmp_path / "none.obj")


@pytest.mark.parametrize(
    ("size", "problem"),
    [
        ([40.0, 50.0, 60.0], r"40 x 50 x 60 m .* millimetres, scale it by 0\.001"),
        ([4.0, 5.0, 6.0], r"more than the table \(1\.6 m\); .* scale it by 0\.001"),
        ([4e-5, 5e-5, 6e-5], "too small to touch .* scale it by 1000"),
        ([1e4, 1.0, 1.0], r"more than the table \(1\.6 m\)$"),
    ],
)
def test_a_size_that_no_object_has_is_refused(tmp_path, size, problem):
    with pytest.raises(ScenarioError, match=problem):
        read(write_obj(tmp_path / "a.obj", box(size)))


def test_millimetres_can_be_scaled(tmp_path):
    path = write_obj(tmp_path / "a.obj", box([40.0, 50.0, 60.0]))
    ((mesh, _),), _ = read(path, 0.001 * ONE)
    np.testing.assert_allclose(mesh.extents, [0.04, 0.05, 0.06])


def test_without_trimesh_the_command_is_told(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "trimesh", None)
    path = write_obj(tmp_path / "a.obj", (box([0.04] * 3)[0], FACES))
    with pytest.raises(ImportError, match=r"pip install .*\[import\]"):
        read(path)
