"""Falling objects start apart."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.objects.config import ObjectConfig
from drake_srg.station.drops import Drops
from drake_srg.types import Box

TABLE = 0.1
angles = st.floats(-np.pi, np.pi)
poses = st.builds(
    lambda r, p, y, x1, x2: RigidTransform(RollPitchYaw(r, p, y), [x1, x2, 0.0]),
    *(angles, angles, angles),
    *(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)),
)
sizes = st.lists(st.floats(0.01, 0.2), min_size=3, max_size=3)
things = st.lists(st.tuples(sizes, poses, st.floats(0.0, 0.05)), min_size=1, max_size=4)


def corners(size, X_WO):
    signs = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1)
    return (X_WO @ (signs * np.array(size)[:, None])).T


@given(things)
def test_boxes_around_falling_things_do_not_overlap(things):
    drops, boxes = Drops(TABLE), []
    for size, X_WO, height in things:
        config = ObjectConfig(shape=Box(size), mass=1.0, friction=1.0, drop=height)
        start = drops.X_WO_start("thing", config, X_WO)
        np.testing.assert_allclose(start.translation()[:2], X_WO.translation()[:2])
        R_WO = X_WO.rotation().matrix()
        np.testing.assert_array_equal(start.rotation().matrix(), R_WO)
        points = corners(size, start)
        low, high = points.min(axis=0), points.max(axis=0)
        assert low[2] >= TABLE + height - 1e-9
        for below, above in boxes:
            assert np.any((low > above - 1e-9) | (high < below + 1e-9))
        boxes.append((low, high))


def test_a_thing_alone_starts_at_its_drop_height():
    config = ObjectConfig(shape=Box([0.1, 0.2, 0.3]), mass=1.0, friction=1.0, drop=0.01)
    X_WO = RigidTransform(RollPitchYaw(0.5 * np.pi, 0.0, 0.0), [0.0, 0.0, 5.0])
    start = Drops(TABLE).X_WO_start("thing", config, X_WO)
    np.testing.assert_allclose(start.translation()[2], TABLE + 0.01 + 0.1)
