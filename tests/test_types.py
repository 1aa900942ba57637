import dataclasses as dc
import enum

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform

from drake_srg.types import (
    Blob,
    BlobFlag,
    Box,
    Cylinder,
    HeightMap,
    LabeledHeightMap,
    Mode,
    PlannerStatus,
    Sphere,
    mode_name,
    mode_words,
)

PLAIN = Blob("can", "eye", (1.0, 2.0), RigidTransform(), 0.9)
HIDDEN = frozenset({BlobFlag.OCCLUDED})
UNCERTAIN = frozenset({BlobFlag.UNCERTAIN})


def blob(**changes):
    return dc.replace(PLAIN, **changes)


def test_trust_ranks_certainty_then_shape_then_flags_then_outline():
    best_first = [
        blob(),
        blob(quality=0.5),
        blob(quality=1.0, flags=HIDDEN),
        blob(quality=1.0, misfit=0.05),
        blob(quality=1.0, misfit=0.05, flags=HIDDEN),
        blob(quality=1.0, flags=UNCERTAIN),
    ]
    assert sorted(best_first, key=lambda b: b.trust, reverse=True) == best_first


blobs = st.builds(
    blob,
    misfit=st.floats(0.0, 2.0),
    quality=st.floats(0.0, 1.0),
    flags=st.frozensets(st.sampled_from(BlobFlag)),
)


@given(blobs, st.floats(0.04, 1.0))
def test_more_misfit_means_less_trust(one, more):
    assert dc.replace(one, misfit=one.misfit + more).trust < one.trust


def test_a_difference_in_misfit_within_noise_does_not_decide():
    assert blob(misfit=0.008).trust > blob(misfit=0.004, quality=0.8).trust
    assert blob(misfit=0.008).trust > blob(misfit=0.004, flags=HIDDEN).trust


class Own(enum.Enum):
    SHAKE_IT = enum.auto()
    LIFT = "lift"


def test_modes_have_names_whatever_their_type():
    modes = (Mode.PRE_GRASP, Own.SHAKE_IT, Own.LIFT, "think_hard")
    names = ["pre_grasp", "shake_it", "lift", "think_hard"]
    assert [mode_name(mode) for mode in modes] == names
    assert mode_words(Own.SHAKE_IT) == "shake it"


def test_a_planner_has_ended_by_the_name_of_its_mode():
    assert PlannerStatus(mode="done").done
    assert PlannerStatus(mode=Mode.FAILED).ended
    assert not PlannerStatus(mode="failed").done
    assert not PlannerStatus(mode=Own.LIFT).ended


# Shapes.

lengths = st.floats(0.001, 1.0)
shapes = st.one_of(
    st.builds(Cylinder, lengths, lengths),
    st.builds(Box, st.lists(lengths, min_size=3, max_size=3)),
    st.builds(Sphere, lengths),
)
directions = (
    st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3)
    .map(np.array)
    .filter(lambda v: np.linalg.norm(v) > 0.1)
    .map(lambda v: v / np.linalg.norm(v))
)


def farthest_point(shape, u):
    """The point of a shape that lies farthest along u, found without half_extent."""
    match shape:
        case Sphere(radius):
            return radius * u
        case Box(size):
            return 0.5 * np.array(size) * np.sign(u)
        case Cylinder(radius, length):
            across = np.linalg.norm(u[:2])
            rim = radius * u[:2] / across if across > 0.0 else np.zeros(2)
            return np.array([*rim, 0.5 * length * np.sign(u[2])])


@given(shapes, directions)
def test_half_extent_reaches_the_farthest_point(shape, u):
    assert shape.half_extent(u) == pytest.approx(farthest_point(shape, u) @ u)


@given(shapes)
def test_extents_agree(shape):
    along_axes = [2.0 * shape.half_extent(axis) for axis in np.eye(3)]
    assert shape.bounding_size == pytest.approx(along_axes)
    assert shape.height == pytest.approx(along_axes[2])


@given(shapes, directions)
def test_the_upright_radius_holds_the_shape(shape, u):
    assert np.linalg.norm(farthest_point(shape, u)[:2]) <= shape.upright_radius + 1e-12


@pytest.mark.slow
@given(shapes, st.floats(0.1, 10.0), directions)
def test_a_scaled_shape_has_scaled_extents(shape, factor, u):
    scaled = shape.scaled(factor)
    assert scaled.half_extent(u) == pytest.approx(factor * shape.half_extent(u))
    assert type(scaled) is type(shape)


def test_the_cells_of_a_height_map():
    map_ = HeightMap(np.array([0.1, -0.2]), 0.01, np.zeros((3, 5)))
    middles = map_.centers()
    assert middles.shape == (3, 5, 2)
    np.testing.assert_allclose(middles[2, 4], [0.14, -0.18])
    rows, columns = np.indices((3, 5))
    np.testing.assert_array_equal(map_.cells(middles), np.stack([rows, columns], -1))
    np.testing.assert_array_equal(map_.cells(np.array([0.084, -0.2])), [0, -2])


def test_maps_are_completed_with_earlier_ones():
    height = np.array([[np.nan, 0.1], [np.nan, 0.2]])
    label = np.array([[-1, 0], [-1, 1]], np.int8)
    labeled = LabeledHeightMap(np.zeros(2), 0.01, height, label, ("a", "b"))
    earlier = LabeledHeightMap(
        np.zeros(2), 0.01, np.full((2, 2), 0.3), np.ones((2, 2), np.int8), ("a", "b")
    )
    whole = labeled.completed(earlier)
    np.testing.assert_array_equal(whole.height, [[0.3, 0.1], [0.3, 0.2]])
    np.testing.assert_array_equal(whole.label, [[1, 0], [1, 1]])
    assert labeled.completed(None) is labeled
