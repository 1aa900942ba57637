import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.planning.grasps.flanks import extent, face_of, lean_of

STEP = 0.002
S = STEP * np.arange(-40, 41.0)
T = np.linspace(-0.017, 0.017, 11)


def test_extents():
    mask = np.zeros((3, 5), bool)
    mask[0, 1:4] = mask[1, 2] = True
    first, last, some = extent(mask, np.arange(5.0))
    np.testing.assert_array_equal(first, [1, 2, 0])
    np.testing.assert_array_equal(last, [3, 2, 0])
    np.testing.assert_array_equal(some, [True, True, False])


@given(tangent=st.floats(0.0, 1.0), half=st.floats(0.03, 0.05))
def test_the_lean_of_flanks(tangent, half):
    """A ridge whose flanks lean by an angle of a known tangent."""
    with np.errstate(divide="ignore"):
        height = np.clip((half - np.abs(S)) / max(tangent, 1e-9), 0.0, 0.05)
    strip, tip, top = height[None].astype(np.float32), np.zeros(1), np.array([0.05])
    low, high, _ = extent(strip > 0.0, S)
    for end, inwards in ((low, 1), (high, -1)):
        lean = lean_of(strip, tip, top, end, inwards, STEP)[0]
        # Both ends are found to one step of 2 mm, over a rise of 12 mm.
        assert tangent - 0.34 < lean < tangent + 0.01


@given(tangent=st.floats(0.0, 1.0))
def test_the_flanks_of_low_things_lean_from_the_fingers_ends_up(tangent):
    """Fingers slipped off the bowl of a spoon that lay upside down."""
    with np.errstate(divide="ignore"):
        height = np.clip((0.025 - np.abs(S)) / max(tangent, 1e-9), 0.0, 0.011)
    strip, tip, top = (
        height[None].astype(np.float32),
        np.full(1, 0.002),
        np.full(1, 0.011),
    )
    low, high, _ = extent(strip > 0.005, S)  # what counts as between the pads
    for end, inwards in ((low, 1), (high, -1)):
        lean = lean_of(strip, tip, top, end, inwards, STEP)[0]
        # To a step of 2 mm at both ends, over a rise of 7.2 mm.
        assert tangent - 0.56 < lean < tangent + 0.28


@given(slope=st.floats(-1.0, 1.0))
def test_the_slant_of_a_face(slope):
    distance = slope * T - (slope * T).min()
    share, middle, found = face_of(distance[None], T)
    assert share[0] > 0.0
    if abs(slope) < 0.4:
        np.testing.assert_allclose(found, slope, atol=0.05)
    else:
        assert np.sign(slope) * found[0] > 0.35
        assert np.sign(slope) * middle[0] < 0.0


def test_a_face_that_ends_is_not_slanted():
    distance = np.where(T < 0.005, 0.0, np.inf)
    share, middle, slope = face_of(distance[None], T)
    np.testing.assert_allclose(slope, 0.0, atol=0.05)
    assert 0.5 < share[0] < 0.8
    assert middle[0] < 0.0
