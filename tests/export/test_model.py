import io
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.geometry import Box, Capsule, Convex, Mesh, ReadObjToTriangleSurfaceMesh
from pydrake.math import RigidTransform

from drake_srg.common.exceptions import ScenarioError
from drake_srg.export.describe import _from_roots
from drake_srg.export.model import Joint, Link, Meshes, Model, numbers
from drake_srg.export.sdf import to_sdf
from drake_srg.export.urdf import to_urdf
from drake_srg.parsing import models_path

IDENTITY = RigidTransform()


def joint(name, parent, child, X_CJ=IDENTITY):
    return Joint(name, "revolute", parent, child, IDENTITY, X_CJ)


def link(name):
    return Link(name, 1.0, np.zeros(3), np.eye(3), IDENTITY)


@given(st.floats(allow_nan=False, allow_infinity=False, width=32))
def test_numbers_read_back(x):
    assert float(numbers(x)) == pytest.approx(x, rel=1e-11, abs=1e-15)


@given(st.permutations(["ab", "bc", "cd", "be"]))
def test_joints_of_parents_come_first(order):
    known = {"a"}
    for each in _from_roots([joint(pair, *pair) for pair in order]):
        assert each.parent in known
        known.add(each.child)


def test_links_that_hold_each_other_are_refused():
    with pytest.raises(ScenarioError, match="joint ab: cannot be exported"):
        list(_from_roots([joint("ab", "a", "b"), joint("ba", "b", "a")]))


@given(
    st.lists(st.sampled_from([1.0, math.inf]), min_size=4, max_size=4),
    st.sampled_from(["revolute", "prismatic"]),
)
def test_urdf_has_every_limit_that_its_readers_require(yourdfpy, limits, kind):
    lower, upper, velocity, effort = limits
    limited = Joint(
        *("ab", kind, "a", "b", IDENTITY, IDENTITY),
        **{"lower": -lower, "upper": upper, "velocity": velocity, "effort": effort},
    )
    text = to_urdf(Model("m", (link("a"), link("b")), (limited,)), Meshes())
    robot = yourdfpy.URDF.load(io.StringIO(text))
    assert robot.validate(), robot.errors
    limit = robot.joint_map["ab"].limit
    assert math.isfinite(limit.effort + limit.velocity)
    if robot.joint_map["ab"].type != "continuous":  # a missing one would mean 0
        assert limit.lower == -min(lower, 1e9)
        assert limit.upper == min(upper, 1e9)


def test_urdf_refuses_an_axis_beside_the_link_and_sdf_takes_it():
    beside = joint("ab", "a", "b", RigidTransform([0.1, 0, 0]))
    model = Model("m", (link("a"), link("b")), (beside,))
    with pytest.raises(ScenarioError, match=r"joint ab: .* \(allowed: --sdf, --mjcf\)"):
        to_urdf(model, Meshes())
    assert "<pose>0.1 0 0 0 0 0</pose>" in to_sdf(model, Meshes())


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
