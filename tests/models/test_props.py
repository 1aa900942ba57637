"""Tables, cans, lids and household objects."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.geometry import Cylinder, Role
from pydrake.math import RigidTransform

from drake_srg.planning.grasps.srg_hand import SrgHand
from drake_srg.types import Box
from models.built_models import (
    CAN,
    NOT_CONVEX,
    SEED,
    Distances,
    build,
    extent,
    mesh_points,
)


@pytest.mark.parametrize("name", ["table", "table_mat"])
def test_table_top_is_at_zero(name):
    built = build(name)
    ((_, shape, X),) = [
        g
        for g in built.shapes(built.bodies()[0], Role.kProximity)
        if g[0].endswith("table_top")
    ]
    centre = X.translation()
    np.testing.assert_allclose(centre + shape.size() / 2, [1.3, 0.8, 0], atol=1e-12)
    np.testing.assert_allclose(
        centre - shape.size() / 2, [-0.4, -0.8, -0.04], atol=1e-12
    )
    frame = built.plant.GetFrameByName("table_top")
    assert frame.CalcPoseInWorld(built.plant_context).IsExactlyIdentity()


def test_can_collides_as_one_cylinder():
    built = build(CAN)
    ((_, shape, X),) = built.shapes(built.plant.GetBodyByName("can"), Role.kProximity)
    assert isinstance(shape, Cylinder)
    assert (shape.radius(), shape.length()) == (0.0339, 0.1018)
    assert X.IsExactlyIdentity()


def test_lid_clears_the_can_it_covers():
    built = build("lid")
    distances = Distances(built.shapes(built.bodies()[0], Role.kProximity))
    for angle in np.linspace(0, 2 * np.pi, 50):
        p = np.array([0.0339 * np.cos(angle), 0.0339 * np.sin(angle), 0.1018])
        assert min(distances.at(p).values()) > 0.02


def test_the_crate_is_too_wide_for_one_hand_but_not_its_end_walls():
    built = build("crate")
    (body,) = built.bodies()
    low, high = extent(built, body)
    np.testing.assert_allclose(high - low, [0.70, 0.26, 0.10], atol=1e-9)
    assert low[2] == 0.0
    hand = SrgHand(["above"], [], squeeze=0.4)
    opening = hand.pinch.max_width
    assert min(high[:2] - low[:2]) > opening
    ends = {
        name: shape.size()
        for name, shape, _ in built.shapes(body, Role.kProximity)
        if "_end_" in name
    }
    assert len(ends) == 2
    for size in ends.values():
        assert size[0] < opening
        assert hand.grasps(Box(size.tolist()), RigidTransform())


def test_the_mark_frames_the_crate():
    built = build("crate_mark")
    (body,) = built.bodies()
    assert not built.shapes(body, Role.kProximity)


@pytest.mark.parametrize("name", NOT_CONVEX)
def test_household_models_are_not_convex(name):
    """Some midpoint between two points of the collision geometry is in free space."""
    built = build(name)
    (body,) = built.bodies()
    shapes = built.shapes(body, Role.kProximity)
    assert len(shapes) > 1
    distances = Distances(shapes)
    corners = np.vstack([(X @ mesh_points(shape).T).T for _, shape, X in shapes])
    rng = np.random.default_rng(SEED)
    middles = 0.5 * (rng.permutation(corners)[:200] + rng.permutation(corners)[:200])
    assert max(min(distances.at(p).values()) for p in middles) > 2e-3


@pytest.mark.parametrize("name", NOT_CONVEX)
def test_household_models_rest_on_z_0(name):
    built = build(name)
    (body,) = built.bodies()
    low, _ = extent(built, body)
    assert low[2] == pytest.approx(0.0, abs=1e-6)
