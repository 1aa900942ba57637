"""Objects that are not one simple shape, and simple ones that lie on any side."""

import itertools

import numpy as np
import pytest
from pydrake.math import RollPitchYaw, RotationMatrix

from drake_srg.common.geometry import centered_pieces
from drake_srg.types import Box
from drake_srg.vision.solids import signed_distance, turn_between
from vision.vision_scene import Thing, locate, target


def block(size, center=(0.0, 0.0, 0.0)):
    """Return the corners of a box, shape (8, 3)."""
    signs = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    return signs * size + center


def ring(radius, height, z=0.0, count=24):
    """Return the corners of an upright prism, shape (2 count, 3)."""
    angle = 2 * np.pi * np.arange(count) / count
    circle = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.array([[*xy, z + end] for end in (0.0, height) for xy in circle])


HAMMER, _ = centered_pieces(
    [block([0.02, 0.10, 0.03]), block([0.16, 0.025, 0.02], (0.09, 0.0, 0.0))]
)
BOTTLE, _ = centered_pieces([ring(0.035, 0.12), ring(0.015, 0.05, z=0.12)])
MUG, _ = centered_pieces(
    [
        ring(0.04, 0.01),
        *[
            np.concatenate(
                [
                    [[r * np.cos(a), r * np.sin(a), z] for a in (a0, a0 + np.pi / 6)]
                    for r in (0.036, 0.04)
                    for z in (0.01, 0.09)
                ]
            )
            for a0 in np.arange(0, 2 * np.pi, np.pi / 6)
        ],
        block([0.008, 0.012, 0.06], (0.065, 0.0, 0.045)),
        block([0.03, 0.012, 0.008], (0.052, 0.0, 0.075)),
        block([0.03, 0.012, 0.008], (0.052, 0.0, 0.015)),
    ]
)
# Seen from above, nothing shows how it is turned.
STOOL, _ = centered_pieces(
    [ring(0.04, 0.02, z=0.05), block([0.012, 0.012, 0.05], (0.02, 0.0, 0.025))]
)
SOLIDS = {"hammer": HAMMER, "bottle": BOTTLE, "mug": MUG}


def lying(solid, R_WO, x, y):
    """Return a thing on the table in some orientation."""
    corners = getattr(solid, "corners", None)
    if corners is None:
        corners = block(solid.size)
    z = -(corners @ R_WO.matrix().T)[:, 2].min()
    return Thing(solid, (x, y, float(z)), rotation=R_WO)


def the_blob(thing):
    (blob,) = locate([thing], [target(shape=thing.shape)])
    assert blob.certain
    error = np.linalg.norm(blob.position - thing.position)
    assert error < 1e-3
    return blob


@pytest.mark.slow
@pytest.mark.parametrize(("name", "yaw"), [("hammer", 1.9), ("mug", -2.4)])
def test_a_standing_object_is_located_with_its_yaw(name, yaw):
    R_WO = RotationMatrix.MakeZRotation(yaw)
    solid = SOLIDS[name]
    blob = the_blob(lying(solid, R_WO, 0.12, -0.08))
    assert turn_between(solid, blob.X_WO.rotation(), R_WO) < np.deg2rad(1.0)


@pytest.mark.slow
def test_what_is_certain_is_right():
    """A mug is nearly round: only its handle shows how it is turned."""
    R_WO = RollPitchYaw(np.pi / 2, 0.0, 5.6).ToRotationMatrix()
    for blob in locate([lying(MUG, R_WO, 0.12, -0.08)], [target(shape=MUG)]):
        turn = turn_between(MUG, blob.X_WO.rotation(), R_WO)
        assert not blob.certain or turn < np.deg2rad(1.0)


def test_a_turn_that_nothing_shows_is_uncertain():
    thing = lying(STOOL, RotationMatrix.MakeZRotation(2.0), 0.0, 0.0)
    (blob,) = locate([thing], [target(shape=STOOL)])
    assert not blob.certain


@pytest.mark.slow
@pytest.mark.parametrize(("tilt", "yaw"), [(0.0, 0.3), (np.pi / 2, 2.0)])
def test_a_bottle_shows_its_axis_only(tilt, yaw):
    R_WO = RollPitchYaw(0.0, tilt, yaw).ToRotationMatrix()
    blob = the_blob(lying(BOTTLE, R_WO, -0.1, 0.1))
    assert blob.axis @ R_WO.matrix()[:, 2] > np.cos(np.deg2rad(1.0))


@pytest.mark.slow
@pytest.mark.parametrize("rpy", [(np.pi / 2, 0, 1.0), (0, np.pi / 2, -0.6)])
def test_a_box_may_lie_on_any_side(rpy):
    shape, R_WO = Box([0.04, 0.07, 0.11]), RollPitchYaw(rpy).ToRotationMatrix()
    blob = the_blob(lying(shape, R_WO, 0.1, 0.1))
    assert turn_between(shape, blob.X_WO.rotation(), R_WO) < np.deg2rad(1.0)


def test_the_distance_is_that_of_the_nearest_piece():
    head, handle = HAMMER.pieces
    beyond = np.array([head[:, 0].min() - 0.01, 0.0, 0.0])
    above = np.array([*handle.mean(axis=0)[:2], handle[:, 2].max() + 0.02])
    distance, gradient = signed_distance(HAMMER, np.array([beyond, above]))
    assert distance == pytest.approx([0.01, 0.02])
    np.testing.assert_allclose(gradient, [[-1, 0, 0], [0, 0, 1]], atol=1e-9)


def test_a_flat_piece_has_no_volume():
    with pytest.raises(ValueError, match="piece 1 of 2 has no volume"):
        centered_pieces([block([1, 1, 1]), block([1, 1, 0])])
