import sys

import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.meshes.files import MeshFile, describe_openness, read_mesh
from objects.meshes.made_meshes import FACES, box, cup, joined, write_obj, write_stl

ONE = np.ones(3)


def read(path, scale=ONE):
    warnings = []
    mesh = read_mesh(MeshFile(path, scale), warnings)
    return mesh.solid, [color for _, color in mesh.surfaces], warnings


@pytest.mark.parametrize("write", [write_obj, write_stl])
def test_a_closed_box_needs_no_mending(tmp_path, write):
    path = write(tmp_path / f"box.{write.__name__[-3:]}", box([0.04, 0.05, 0.06]))
    mesh, colors, warnings = read(path)
    assert mesh.volume == pytest.approx(0.04 * 0.05 * 0.06)
    assert (colors, warnings, describe_openness(mesh)) == ([None], [], "")


def test_gltf_points_up_along_y(tmp_path):
    trimesh = pytest.importorskip("trimesh")  # of the extra `import`
    path = tmp_path / "box.glb"
    trimesh.Trimesh(*box([0.04, 0.05, 0.06], at=[0, 0.025, 0])).export(path)
    mesh, _, _ = read(path)
    np.testing.assert_allclose(mesh.bounds[:, 2], [0.0, 0.05], atol=1e-9)


def test_an_obj_has_the_colour_of_its_material(tmp_path):
    (tmp_path / "red.mtl").write_text("newmtl red\nKd 0.8 0.2 0.1\n")
    path = tmp_path / "box.obj"
    write_obj(path, box([0.04] * 3), head="mtllib red.mtl\nusemtl red")
    _, (color,), _ = read(path)
    assert color == pytest.approx((0.8, 0.2, 0.1), abs=0.01)


def test_faces_that_point_inwards_are_turned(tmp_path):
    vertices, faces = box([0.04] * 3)
    mesh, _, warnings = read(write_obj(tmp_path / "a.obj", (vertices, faces[:, ::-1])))
    assert mesh.volume == pytest.approx(0.04**3)
    assert "pointed inwards" in warnings[0]


def test_a_mirrored_mesh_is_not_inside_out(tmp_path):
    path = write_obj(tmp_path / "a.obj", box([0.04, 0.05, 0.06]))
    mesh, _, warnings = read(path, np.array([1.0, -1.0, 1.0]))
    assert mesh.volume == pytest.approx(0.04 * 0.05 * 0.06)
    assert warnings == []


def test_a_hollow_stays_hollow(tmp_path):
    inner, faces = box([0.02] * 3)
    mesh = joined(box([0.04] * 3), (inner, faces[:, ::-1]))
    mesh, _, warnings = read(write_obj(tmp_path / "a.obj", mesh))
    assert mesh.volume == pytest.approx(0.04**3 - 0.02**3)
    assert warnings == []


def test_an_open_mesh_says_where(tmp_path):
    vertices, faces = box([0.04] * 3)
    mesh, _, _ = read(write_obj(tmp_path / "a.obj", (vertices, faces[2:])))
    text = describe_openness(mesh)
    assert text.startswith("open at 4 edges")
    assert "-0.02" in text  # the missing face is at x = -0.02


def test_faces_that_disagree_are_told(tmp_path):
    vertices, faces = box([0.04] * 3)
    faces = np.vstack([faces[:1, ::-1], faces[1:]])
    mesh, _, _ = read(write_obj(tmp_path / "a.obj", (vertices, faces)))
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
        ("a.glb", "hello", "cannot be read as glTF"),
        ("a.ply", "hello", r"unknown format \(allowed: .sdf, .urdf, .obj"),
    ],
)
def test_what_is_not_a_mesh_is_refused(tmp_path, name, content, problem):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(ScenarioError, match=rf"{name}: .*{problem}"):
        read(path)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(ScenarioError, match=r"none\.obj: cannot be read: No such file"):
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
    mesh, _, _ = read(path, 0.001 * ONE)
    np.testing.assert_allclose(mesh.extents, [0.04, 0.05, 0.06])


def test_without_trimesh_the_command_is_told(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "trimesh", None)
    path = write_obj(tmp_path / "a.obj", (box([0.04] * 3)[0], FACES))
    with pytest.raises(ImportError, match=r"pip install .*\[import\]"):
        read(path)


def test_materials_colour_a_body_and_do_not_split_it(tmp_path):
    """Each material covers half of the cube, so neither half is closed."""
    (tmp_path / "two.mtl").write_text("newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 0 1\n")
    path = tmp_path / "a.obj"
    head, materials = "mtllib two.mtl", [("a", 0), ("b", 5)]
    mesh, colors, warnings = read(write_obj(path, box([0.04] * 3), head, materials))
    assert (mesh.is_volume, len(mesh.faces), warnings) == (True, 12, [])
    assert mesh.volume == pytest.approx(0.04**3)
    assert sorted(colors) == [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0)]


def test_a_glazed_cup_stays_hollow(tmp_path):
    vertices, faces, inside = cup()
    (tmp_path / "two.mtl").write_text("newmtl clay\nnewmtl glaze\n")
    path = tmp_path / "a.obj"
    materials = [("clay", 0), ("glaze", inside)]
    write_obj(path, (vertices, faces), "mtllib two.mtl", materials)
    mesh, _, _ = read(path)
    assert describe_openness(mesh) == ""
    assert mesh.volume == pytest.approx(0.06**3 - 0.048**2 * 0.054)


def test_turned_faces_are_seen_in_their_colour(tmp_path):
    (tmp_path / "two.mtl").write_text("newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 0 1\n")
    vertices, faces = box([0.04] * 3)
    path = tmp_path / "a.obj"
    head, materials = "mtllib two.mtl", [("a", 0), ("b", 2)]
    write_obj(path, (vertices, faces[:, ::-1]), head, materials)
    seen = {c: m for m, c in read_mesh(MeshFile(path, ONE), []).surfaces}
    red = seen[(1.0, 0.0, 0.0)]  # the faces at -x
    np.testing.assert_allclose(red.face_normals, [[-1, 0, 0]] * 2, atol=1e-12)
    assert len(seen[(0.0, 0.0, 1.0)].faces) == 10


@pytest.mark.parametrize(
    ("head", "materials", "told"),
    [
        ("mtllib none.mtl\nusemtl red", "", "none.mtl, material red"),
        ("mtllib red.mtl\nusemtl blue", "newmtl red", "material blue"),
        ("mtllib red.mtl\nusemtl red", "newmtl red\nmap_Kd a.png", "a.png"),
    ],
)
def test_a_lost_colour_is_told(tmp_path, head, materials, told):
    (tmp_path / "red.mtl").write_text(materials)
    path = write_obj(tmp_path / "a.obj", box([0.04] * 3), head)
    _, _, (warning,) = read(path)
    assert warning == f"does not exist, so its colour is lost: {told}"


@pytest.mark.parametrize("name", ["my red.mtl", "rot-ü.mtl", "50%20#.mtl"])
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "utf-16", "utf-8-sig"])
def test_materials_are_found_by_any_name(tmp_path, name, encoding):
    (tmp_path / name).write_text("newmtl red\nKd 0.8 0.2 0.1\n", encoding)
    path = write_obj(tmp_path / "a.obj", box([0.04] * 3), f"mtllib {name}\nusemtl red")
    path.write_text(path.read_text(), encoding)
    _, (color,), warnings = read(path)
    assert color == pytest.approx((0.8, 0.2, 0.1), abs=0.01)
    assert warnings == []


def test_materials_may_be_in_several_files(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl a\nKd 1 0 0\n")
    (tmp_path / "b.mtl").write_text("newmtl b\nKd 0 0 1\n")
    head = "# see mtllib\nmtllib a.mtl b.mtl\nusemtl b"
    _, colors, warnings = read(write_obj(tmp_path / "a.obj", box([0.04] * 3), head))
    assert (colors, warnings) == ([(0.0, 0.0, 1.0)], [])
