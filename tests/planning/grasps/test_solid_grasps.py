"""Pinches of known solids, such as a hammer of two boxes and a shelf on a post."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_srg.common.geometry import ConvexPieces
from drake_srg.planning.grasps.solid_grasps import solid_map, solid_pinches
from drake_srg.planning.grasps.srg_hand import SrgFingers

FINGERS = SrgFingers()
CLEARANCE = 0.005
UP = (0.0, 0.0, 1.0)
CUBE = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0, 1)])


def block(size, at=(0.0, 0.0, 0.0)):
    """Return the corners of a block that stands at a place [m]."""
    return CUBE * size + at


HANDLE = block([0.2, 0.025, 0.03], [-0.1, 0.0, 0.0])
HAMMER = ConvexPieces((HANDLE, block([0.04, 0.1, 0.04], [0.02, 0.0, 0.0])))


def test_a_map_shows_the_top_of_each_part():
    shelf = block([0.1, 0.1, 0.01], [0.0, 0.0, 0.09])
    seen = solid_map(
        ConvexPieces((block([0.02, 0.02, 0.1]), shelf)).translated([0, 0, 3])
    )
    inside = np.max(np.abs(seen.centers()), axis=-1) < 0.049
    np.testing.assert_allclose(seen.height[inside], 0.1)
    outside = np.max(np.abs(seen.centers()), axis=-1) > 0.051
    np.testing.assert_allclose(seen.height[outside], 0.0)
    assert np.count_nonzero(outside) > np.count_nonzero(inside)
    wedge = ConvexPieces((np.delete(block([0.1, 0.1, 0.1]), [1, 3], axis=0),))
    seen = solid_map(wedge)
    x = seen.centers()[..., 0]
    np.testing.assert_allclose(seen.height[inside], x[inside] + 0.05, atol=1e-9)


def test_pads_are_on_both_sides_of_what_they_take():
    pinches = solid_pinches(FINGERS, HAMMER, UP, CLEARANCE)
    assert pinches
    middle = np.array([*HAMMER.corners.mean(axis=0)[:2], 0.0])
    for grasp in pinches:
        X_OG = grasp.X_GO.inverse()
        p_OG, R_OG = X_OG.translation(), X_OG.rotation().matrix()
        np.testing.assert_allclose(R_OG[:, 0], [0.0, 0.0, -1.0], atol=1e-9)  # down
        # The palm is above the solid, and the ends of the fingers above the table.
        assert p_OG[2] - FINGERS.palm_x > 0.03
        assert p_OG[2] - FINGERS.deepest > CLEARANCE
        assert np.linalg.norm(p_OG[:2] - middle[:2]) < 0.2
        # Between the pads is the solid; where the open fingers come down, it is not.
        pad = np.linspace(-0.5, 0.5, 9)[:, None] * FINGERS.pad_width * R_OG[:, 2]
        assert max(height_at(HAMMER, p_OG + p) for p in pad) > 0.02
        for side in (-1.0, 1.0):
            gap = 0.5 * grasp.width + 0.008
            assert height_at(HAMMER, p_OG + side * gap * R_OG[:, 1]) == 0.0


def height_at(solid, p_O):
    """Return the height of a solid at a place [m]."""
    seen = solid_map(solid)
    return seen.height[tuple(seen.cells(p_O[:2]))]


def test_either_finger_may_be_in_front():
    pinches = solid_pinches(FINGERS, HAMMER, UP, CLEARANCE)
    for one, other in zip(pinches[::2], pinches[1::2], strict=True):
        assert one.name == other.name
        np.testing.assert_allclose(one.across_O, -other.across_O, atol=1e-9)


def test_pinches_near_the_centre_of_mass_are_better():
    def lever(grasp):
        X_OG = grasp.X_GO.inverse()
        apart = HAMMER.center_of_mass - X_OG.translation()
        return abs(apart @ X_OG.rotation().matrix()[:, 2])

    pinches = sorted(
        solid_pinches(FINGERS, HAMMER, UP, CLEARANCE), key=lambda g: g.cost
    )
    assert lever(pinches[0]) < 0.02 < max(map(lever, pinches))


def test_the_hand_is_where_the_solid_is():
    """Wherever the solid stands, the arm's target puts the palm above it."""
    grasp = solid_pinches(FINGERS, HAMMER.translated([0.1, 0.0, 0.2]), UP, CLEARANCE)[0]
    X_WO = RigidTransform(RollPitchYaw(0.0, 0.0, 1.2), [0.6, 0.1, 0.5])
    target = grasp.pick_target(X_WO)
    np.testing.assert_allclose(target.p_WT, X_WO.translation())
    X_WG = X_WO @ grasp.X_GO.inverse()
    assert target.angle_violation(X_WG) < 1e-9
    np.testing.assert_allclose(X_WG @ target.p_GT, target.p_WT, atol=1e-9)


def test_what_is_wider_than_the_hand_has_no_pinch():
    slab = ConvexPieces((block([0.25, 0.25, 0.05]),))
    assert not solid_pinches(FINGERS, slab, UP, CLEARANCE)


@pytest.mark.parametrize(
    "turn", [(np.pi, 0.0), (0.5 * np.pi, 0.0), (0.0, -0.5 * np.pi)]
)
def test_what_lies_on_another_side_is_taken_as_it_lies(turn):
    """Its grasps are those of a solid that is modelled in this orientation."""
    R = RollPitchYaw(*turn, 0.0).ToRotationMatrix().matrix()
    lying = solid_pinches(FINGERS, HAMMER, tuple(R[2]), CLEARANCE)
    modelled = solid_pinches(FINGERS, HAMMER.rotated(R), UP, CLEARANCE)
    best, same = (min(found, key=lambda g: g.cost) for found in (lying, modelled))
    assert best.width == pytest.approx(same.width, abs=0.01)
    np.testing.assert_allclose(best.axis_O, R[2], atol=1e-9)
    # On its goal, the same side is down, whatever the yaw.
    down = best.X_GO.rotation() @ best.axis_O
    np.testing.assert_allclose(down, [-1.0, 0.0, 0.0], atol=1e-9)
    R_WO = RotationMatrix.MakeZRotation(0.7) @ RotationMatrix(R)
    X_WO = RigidTransform(R_WO, [0.5, 0.1, 0.2])
    target = best.target(X_WO)
    assert target.angle_violation(X_WO @ best.X_GO.inverse()) < 1e-6
