import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.planning.grasps.linkage_hand import LinkageFingers
from drake_srg.planning.grasps.srg_hand import SrgFingers
from drake_srg.planning.grasps.surface_grasps import KnownSurface, SurfaceGrasps
from drake_srg.types import Box, Cylinder, Failure, HeightMap, Sphere

SHAPES = [Box([0.1, 0.04, 0.06]), Cylinder(0.03, 0.1), Sphere(0.04)]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
@given(seed=st.integers(0, 99))
def test_points_lie_where_their_normals_touch_the_shape(shape, seed):
    surface = KnownSurface.of_shape(shape, 50, np.random.default_rng(seed))
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1.0)
    extents = [shape.half_extent(normal) for normal in surface.normals]
    along = np.sum(surface.points * surface.normals, axis=1)
    np.testing.assert_allclose(along, extents, atol=1e-9)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_points_are_spread_evenly(shape):
    surface = KnownSurface.of_shape(shape, 20_000, np.random.default_rng(0))
    # The mean of n n^T over a closed surface's area, by faces: twice the projections.
    np.testing.assert_allclose(surface.points.mean(axis=0), 0.0, atol=2e-3)
    np.testing.assert_allclose(surface.normals.mean(axis=0), 0.0, atol=2e-2)


def test_points_of_a_mesh():
    vertices = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.1]])
    triangles = np.array([[0, 2, 1], [0, 1, 3]])
    surface = KnownSurface.of_mesh(vertices, triangles, 3000, np.random.default_rng(0))
    below = surface.normals[:, 2] < -0.5
    np.testing.assert_allclose(surface.normals[below], [[0, 0, -1]] * below.sum())
    np.testing.assert_allclose(surface.points[below, 2], 0.0, atol=1e-12)
    assert below.mean() == pytest.approx(2 / 3, abs=0.03)
    middle = surface.points[below].mean(axis=0)
    np.testing.assert_allclose(middle, [0.1 / 3, 0.2 / 3, 0], atol=3e-3)
    with pytest.raises(ValueError, match="some area"):
        KnownSurface.of_mesh(vertices, triangles[:0], 10, np.random.default_rng(0))


def test_a_pose_moves_points_and_turns_normals():
    surface = KnownSurface.of_shape(SHAPES[0], 20, np.random.default_rng(1))
    X_WO = RigidTransform(RollPitchYaw(0.3, 0.2, 0.1), [1.0, 2.0, 3.0])
    posed = surface.posed(X_WO)
    for i in range(20):
        np.testing.assert_allclose(posed.points[i], X_WO @ surface.points[i])
        rotated = X_WO.rotation() @ surface.normals[i]
        np.testing.assert_allclose(posed.normals[i], rotated)


N = 150
PAGE = Path(__file__).parents[3] / "docs" / "grasps.md"


def table(height=0.0):
    """Return the map of an empty table that has not been seen."""
    return HeightMap(np.full(2, -0.149), 0.002, np.full((N, N), height))


def plan(shape, rpy=(0, 0, 0), fingers=None, map_=None):
    """Return grasps of a shape that rests on the table near its middle."""
    R_WO = RollPitchYaw(rpy).ToRotationMatrix()
    z = shape.half_extent(R_WO.matrix()[2])
    surface = KnownSurface.of_shape(shape, 20_000, np.random.default_rng(0))
    posed = surface.posed(RigidTransform(R_WO, [0.01, -0.02, z]))
    planner = SurfaceGrasps(fingers or SrgFingers(), 0.0, [posed])
    return planner.plan(table() if map_ is None else map_)


@pytest.mark.parametrize(
    ("shape", "rpy", "width"),
    [
        (Box([0.12, 0.05, 0.04]), (0, 0, 0.5), 0.05),
        (Sphere(0.035), (0, 0, 0), 0.07),
        (Cylinder(0.03, 0.1), (0, 0, 0), 0.06),
        (Cylinder(0.03, 0.14), (np.pi / 2, 0, 1.0), 0.06),
    ],
    ids=["box", "ball", "standing", "lying"],
)
def test_shapes_are_taken_across_their_narrow_side(shape, rpy, width):
    found = plan(shape, rpy)
    assert (found.things, found.refused) == (1, ())
    grasp = found.grasps[0]
    assert grasp.width == pytest.approx(width, abs=0.008)
    np.testing.assert_allclose(grasp.p_WC[:2], [0.01, -0.02], atol=0.02)


def test_a_known_thing_is_taken_without_having_been_seen():
    unseen = table()
    unseen.height[60:90, 60:90] = np.nan
    assert plan(Cylinder(0.03, 0.1), map_=unseen).grasps


def test_the_linkage_takes_what_is_narrow():
    assert plan(Cylinder(0.0125, 0.05), fingers=LinkageFingers()).grasps
    wide = plan(Cylinder(0.035, 0.05), fingers=LinkageFingers())
    assert [refusal.failure for refusal in wide.refused] == [Failure.TOO_WIDE]


def test_the_code_of_the_page_runs():
    (block,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    exec(compile(block, str(PAGE), "exec"), {})
