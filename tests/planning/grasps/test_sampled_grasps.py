"""Samples of grasps of a known solid from all directions."""

import numpy as np
import pytest

from drake_srg.common.geometry import ConvexPieces
from drake_srg.planning import SrgFingers
from drake_srg.planning.grasps.sampled_grasps import sample_grasps

HALF = np.array([0.03, 0.04, 0.05])  # of a box [m]
CORNERS = HALF * np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
BOX = ConvexPieces((CORNERS,))


@pytest.fixture(scope="module")
def samples():
    return [
        grasp
        for direction in range(4)
        for grasp in sample_grasps(SrgFingers(), BOX, 1, direction)
    ]


def test_pads_of_planned_grasps_are_on_both_sides_of_the_solid(samples):
    planned = [grasp for grasp in samples if not grasp.shifted]
    assert len(planned) >= 8
    for grasp in planned:
        X_GO = grasp.X_OG.inverse()
        ahead = X_GO.translation()[0]
        assert 0.07 < ahead < 0.25
        y = (X_GO.multiply(CORNERS.T))[1]
        assert y.min() < 0.0 < y.max()
        assert grasp.width < 2.0 * grasp.half_gap


def test_every_planned_grasp_comes_a_second_time_moved_a_little(samples):
    for planned, moved in zip(samples[::2], samples[1::2], strict=True):
        assert (planned.shifted, moved.shifted) == (False, True)
        X = planned.X_OG.inverse() @ moved.X_OG
        assert 0.0 < np.linalg.norm(X.translation()) < 0.02
        angle = X.rotation().ToAngleAxis().angle()
        assert 0.0 < angle < np.deg2rad(15.1)


def test_hands_come_from_all_sides(samples):
    directions = [grasp.X_OG.rotation().matrix()[:, 0] for grasp in samples]
    assert np.linalg.matrix_rank(np.array(directions), tol=0.3) == 3


def test_a_direction_is_drawn_on_its_own(samples):
    again = sample_grasps(SrgFingers(), BOX, 1, 2)
    poses = [grasp.X_OG.GetAsMatrix34() for grasp in samples]
    for grasp in again:
        assert any(np.array_equal(grasp.X_OG.GetAsMatrix34(), x) for x in poses)
    other = sample_grasps(SrgFingers(), BOX, 2, 2)
    assert not np.array_equal(
        other[0].X_OG.GetAsMatrix34(), again[0].X_OG.GetAsMatrix34()
    )
