import numpy as np
import pytest
from pydrake.geometry import Box, Capsule, Convex, Mesh, ReadObjToTriangleSurfaceMesh

from drake_srg.export.meshes import Meshes
from drake_srg.parsing import models_path

TETRAHEDRON = """mtllib a.mtl
v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
usemtl red
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""


@pytest.fixture
def obj(tmp_path):
    def write(folder, text=TETRAHEDRON):
        path = tmp_path / folder / "part.obj"
        path.parent.mkdir()
        path.write_text(text)
        return str(path)

    return write


def test_simple_shapes_need_no_file():
    assert Meshes().file(Box(1, 1, 1), "box") is None


def test_equal_meshes_share_a_file_and_others_do_not(obj):
    meshes = Meshes()
    a, b = obj("a"), obj("b")
    c = obj("c", TETRAHEDRON.replace("v 1", "v 2"))
    names = [meshes.file(Mesh(path), "x").name for path in (a, b, c)]
    assert names == ["part", "part", "part_2"]
    assert meshes.texts.keys() == {"part", "part_2"}


def test_materials_stay_behind_and_scale_stays(obj):
    meshes = Meshes()
    file = meshes.file(Convex(obj("a"), 2.0), "x")
    assert (file.name, file.convex) == ("part", True)
    np.testing.assert_array_equal(file.scale, [2, 2, 2])
    assert "mtl" not in meshes.texts["part"]
    assert meshes.texts["part"].count("f ") == 4


@pytest.mark.parametrize(
    "shape",
    [Capsule(0.1, 0.2), Mesh(str(models_path() / "meshes" / "srg_pad_840.vtk"))],
    ids=["capsule", "volume"],
)
def test_other_shapes_and_formats_become_wavefront(shape, tmp_path):
    meshes = Meshes()
    file = meshes.file(shape, "thing")
    path = tmp_path / "thing.obj"
    path.write_text(meshes.texts[file.name])
    found = ReadObjToTriangleSurfaceMesh(path)
    assert found.num_triangles() >= 12
    assert file.convex == isinstance(shape, Mesh)
