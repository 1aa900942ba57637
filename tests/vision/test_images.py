import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from hypothesis.extra.numpy import arrays

from drake_srg.vision import images as module
from drake_srg.vision.images import (
    clean,
    clean_and_measure,
    depth_noise,
    narrowest_rectangle,
    robust_deviation,
)


@pytest.mark.parametrize("outliers", [0, 300])
def test_it_is_the_standard_deviation_with_and_without_outliers(outliers):
    residuals = np.random.default_rng(0).normal(0.0, 2e-3, 10_000)
    residuals[:outliers] = 1.0
    assert robust_deviation(residuals) == pytest.approx(2e-3, rel=0.05)


finite_or_not = st.floats(allow_nan=False, width=32)


@given(
    st.sampled_from([np.float32, np.float64]).flatmap(
        lambda dtype: arrays(dtype, st.integers(1, 9), elements=finite_or_not)
    )
)
def test_it_uses_the_median_to_the_last_bit(residuals):
    with np.errstate(over="ignore"):
        median = np.median(np.abs(residuals))
        assert robust_deviation(residuals) == 1.4826 * float(median)


def test_without_residuals_it_is_nan():
    assert np.isnan(robust_deviation(np.zeros(0)))


lengths = st.floats(0.01, 0.2)
places = st.floats(-0.5, 0.5)


@given(lengths, lengths, places, places, st.floats(-3.0, 3.0))
def test_it_holds_a_rectangles_corners_and_is_no_wider(length, width, x, y, yaw):
    c, s = np.cos(yaw), np.sin(yaw)
    corners = 0.5 * np.array([[length, width], [-length, width], [-length, -width]])
    corners = np.concatenate([corners, -corners[1:2]])
    points = corners @ [[c, s], [-s, c]] + [x, y]
    center, sides, found_yaw = narrowest_rectangle(points)
    # Single precision in units of 0.1 mm: 5000 of them have a resolution of 0.0005.
    assert center == pytest.approx([x, y], abs=1e-6)
    assert sorted(sides) == pytest.approx(sorted([length, width]), abs=1e-6)
    c, s = np.cos(found_yaw), np.sin(found_yaw)
    beyond = np.abs((points - center) @ [[c, -s], [s, c]]) - 0.5 * sides
    assert beyond.max() < 1e-6


HEIGHT, WIDTH = 120, 160
U = np.arange(WIDTH) - WIDTH / 2
EDGE = WIDTH // 2


def plane(slope=0.0):
    """Return the depth of a plane, which is linear in 1 / depth."""
    return np.broadcast_to(1.0 / (0.8 + slope * U), (HEIGHT, WIDTH)).astype(np.float32)


def noisy(depth, noise, seed=0):
    rng = np.random.default_rng(seed)
    return (depth + noise * depth**2 * rng.normal(size=depth.shape)).astype(np.float32)


def step():
    """Return an image with a near and a far half."""
    return np.where(U < 0, 1.0, 1.1)[None].repeat(HEIGHT, 0).astype(np.float32)


@pytest.mark.parametrize("slope", [0.0, 1e-3])
@pytest.mark.parametrize("noise", [1e-4, 2e-3])
def test_noise_is_measured_at_any_slope(slope, noise):
    measured = depth_noise(noisy(plane(slope), noise))
    assert measured == pytest.approx(noise, rel=0.05)
    assert depth_noise(plane(slope)) < 1e-6


def test_edges_and_holes_do_not_count_as_noise():
    depth = step()
    depth[::7, ::5] = 0.0
    depth[5:20] = np.inf
    assert depth_noise(depth) < 1e-6
    assert depth_noise(np.zeros((HEIGHT, WIDTH), np.float32)) == 0.0


def test_an_image_without_noise_is_unchanged():
    depth = step()
    depth[3, 4] = 0.0
    cleaned, noise = clean_and_measure(depth)
    assert cleaned is depth
    assert noise == 0.0


def test_an_image_without_noise_needs_no_median(monkeypatch):
    monkeypatch.delattr(module, "robust_deviation")
    depth = step()
    assert clean(depth) is depth


@given(
    hnp.arrays(
        np.float32,
        st.tuples(st.integers(1, 6), st.integers(9, 15)),
        elements=st.floats(0.5, 0.5 + 2**-13, width=32)
        | st.sampled_from([0.0, 1.0, np.inf]),
    ),
    st.sampled_from([0.0, 0.5, 1.0, 1.001, 1.5, 2.0, 10.0]),
)
def test_only_images_with_less_noise_than_allowed_are_unchanged(depth, factor):
    noise = depth_noise(depth)
    noiseless = factor * noise
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_NOISELESS", noiseless)
        assert (clean(depth) is depth) == (noise < noiseless)


def test_cleaning_removes_noise_and_single_holes():
    rng = np.random.default_rng(1)
    depth = noisy(plane(), 1e-3)
    depth[rng.random(depth.shape) < 0.02] = 0.0
    cleaned, noise = clean_and_measure(depth)
    assert (cleaned > 0).all()
    assert noise < 0.6e-3
    assert (cleaned - plane()).std() < 0.6e-3 * 1.25**2


def test_holes_along_an_edge_do_not_move_it():
    rng = np.random.default_rng(2)
    depth = noisy(step(), 1e-3)
    band = slice(EDGE - 1, EDGE + 1)
    lost = rng.random((HEIGHT, 2)) < 0.5
    depth[:, band] = np.where(lost, 0.0, depth[:, band])
    near = (clean(depth) < 1.05).sum(axis=1)
    # Half of the holes are on either side of the edge, so the mean stays.
    assert near.mean() == pytest.approx(EDGE, abs=0.15)


def test_unknown_and_far_pixels_stay_so():
    depth = noisy(step(), 1e-3)
    depth[:, :40] = 0.0
    depth[:, -40:] = np.inf
    cleaned = clean(depth)
    assert (cleaned[:, :38] == 0.0).all()
    assert np.isinf(cleaned[:, -38:]).all()
