import collections
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    Mesh,
    MeshcatCone,
    Sphere,
)
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.recording.replay.triangles import arrow, read_obj, shape_triangles

SIZE = st.floats(0.01, 3.0)
MESHES = Path(__file__).parents[3] / "models/meshes"
CUBE = """# a cube of polygons, its indices counted from the start and from the end
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
f 4 3 2 1
f -4 -3 -2 -1
f 1 2 6 5
f 2/7 3/7 7/7 6/7
f 3 4 8 7
f 4 1 5 8
"""


def volume(surface):
    """Return the enclosed volume, by the divergence theorem."""
    a, b, c = surface.points[surface.faces].transpose(1, 0, 2)
    return float(np.sum(a * np.cross(b, c)) / 6)


def assert_closed(surface):
    """Every edge belongs to two triangles, once in each direction."""
    places = np.unique(surface.points.round(9), axis=0, return_inverse=True)[1]
    edges = collections.Counter()
    for a, b, c in places.reshape(-1)[surface.faces]:
        if len({a, b, c}) == 3:
            edges.update([(a, b), (b, c), (c, a)])
    assert all(edges[b, a] == count for (a, b), count in edges.items())


def assert_normals_point_out(surface):
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1, atol=1e-6)
    a, b, c = surface.points[surface.faces].transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    area = np.linalg.norm(across, axis=1)
    mean = surface.normals[surface.faces].mean(axis=1)
    inwards = np.sum(across * mean, axis=1) <= 0
    assert not np.any(inwards & (area > 1e-9 * area.max()))


@pytest.mark.parametrize("kind", ["box", "cylinder", "sphere", "capsule", "ellipsoid"])
@given(a=SIZE, b=SIZE, c=SIZE)
def test_a_shape_is_closed_and_encloses_its_volume(kind, a, b, c):
    shape, exact = {
        "box": (Box(a, b, c), a * b * c),
        "cylinder": (Cylinder(a, b), np.pi * a**2 * b),
        "sphere": (Sphere(a), 4 / 3 * np.pi * a**3),
        "capsule": (Capsule(a, b), np.pi * a**2 * (4 / 3 * a + b)),
        "ellipsoid": (Ellipsoid(a, b, c), 4 / 3 * np.pi * a * b * c),
    }[kind]
    surface = shape_triangles(shape)
    assert_normals_point_out(surface)
    assert volume(surface) == pytest.approx(exact, rel=0.01)


@pytest.mark.parametrize(
    "shape",
    [Box(1, 2, 3), Cylinder(1, 2), Sphere(1), Capsule(1, 2), Ellipsoid(1, 2, 3)],
    ids=lambda shape: type(shape).__name__,
)
def test_a_shape_has_no_holes(shape):
    assert_closed(shape_triangles(shape))


def test_an_arrow_points_along_z_at_the_origin():
    surface = arrow()
    assert_normals_point_out(surface)
    assert surface.points[:, 2].min() == -1
    tip = surface.points[surface.points[:, 2] == surface.points[:, 2].max()]
    assert np.all(tip == 0)


def test_a_half_space_is_a_square_and_other_shapes_nothing():
    surface = shape_triangles(HalfSpace())
    np.testing.assert_array_equal(surface.normals, [[0, 0, 1]] * 6)
    assert np.all(surface.points[:, 2] == 0)
    assert shape_triangles(MeshcatCone(1, 1, 1)) is None


@pytest.fixture
def cube(tmp_path):
    path = tmp_path / "cube.obj"
    path.write_text(CUBE)
    return path


def test_polygons_without_normals_become_flat_triangles(cube):
    surface = read_obj(cube)
    assert surface.faces.shape == (12, 3)
    assert_closed(surface)
    assert_normals_point_out(surface)
    assert volume(surface) == pytest.approx(1)


@given(
    factors=st.tuples(*3 * [st.one_of(SIZE, SIZE.map(lambda x: -x))]),
    angles=st.tuples(*3 * [st.floats(-3, 3)]),
)
def test_scaled_and_moved_surfaces_keep_their_outside(factors, angles):
    surface = read_obj(MESHES / "srg_palm_shell.obj")
    X = RigidTransform(RollPitchYaw(*angles), [1.0, 2.0, 3.0])
    moved = surface.scaled(np.array(factors)).transformed(X)
    assert_normals_point_out_mostly(moved)
    exact = volume(surface) * abs(np.prod(factors))
    assert volume(moved) == pytest.approx(exact, rel=1e-6, abs=1e-9)


def assert_normals_point_out_mostly(surface):
    """Smoothed normals of slivers may lean; nearly all the area has them outside."""
    a, b, c = surface.points[surface.faces].transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    area = np.linalg.norm(across, axis=1)
    outwards = np.sum(across * surface.normals[surface.faces].mean(axis=1), axis=1) > 0
    assert area[outwards].sum() > 0.99 * area.sum()


def test_a_mesh_is_scaled(cube):
    surface = shape_triangles(Mesh(str(cube), scale3=[1, 2, 3]))
    assert volume(surface) == pytest.approx(6)


def test_a_convex_is_drawn_as_its_hull(cube):
    surface = shape_triangles(Convex(str(cube), 2.0))
    assert_closed(surface)
    assert_normals_point_out(surface)
    assert volume(surface) == pytest.approx(8)


@pytest.mark.parametrize(
    "text", ["", "v 0 0 0", "f 1 2 3", "v 0 0 0\nf 1//2 1//2 1//2", "v 0 0 0\nf 1 1 -3"]
)
def test_what_is_no_mesh_is_refused(tmp_path, text):
    path = tmp_path / "bad.obj"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"bad\.obj"):
        read_obj(path)


def test_our_meshes_are_read():
    paths = [path for path in MESHES.glob("*.obj") if "collision" not in path.stem]
    assert len(paths) > 50
    for path in paths:
        surface = read_obj(path)
        assert np.all(np.isfinite(surface.points)), path
        assert surface.faces.max() < len(surface.points), path
