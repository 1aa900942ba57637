import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.types import Box, Cylinder
from drake_srg.vision.outline import (
    circle,
    fit_outline,
    guess_rectangle,
    outline_samples,
    rectangle,
)

PIXEL = 0.0023
offsets = st.floats(-PIXEL, PIXEL)
yaws = st.floats(-np.pi, np.pi)


def pixels(half=0.12):
    axis = np.arange(-half, half, PIXEL)
    return np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)


@given(offsets, offsets, st.floats(0.012, 0.05))
def test_a_digitised_disc_is_placed_to_a_fraction_of_a_pixel(x, y, radius):
    truth = np.array([x, y])
    outline = circle(radius)
    inside = outline(pixels(), truth)[0] <= 0
    found = fit_outline(outline, pixels(), inside, np.array([4e-3, -3e-3]), PIXEL)
    assert np.abs(found - truth).max() < 0.15 * PIXEL


@given(offsets, offsets)
def test_half_a_disc_is_enough(x, y):
    truth = np.array([x, y])
    outline = circle(0.0339)
    points = pixels()
    points = points[points[:, 0] < 0.005]
    inside = outline(points, truth)[0] <= 0
    found = fit_outline(outline, points, inside, np.array([-0.01, 0.0]), PIXEL)
    assert np.abs(found - truth).max() < 0.3 * PIXEL


@given(offsets, offsets, st.integers(0, 1000))
def test_wrong_labels_do_little(x, y, seed):
    truth = np.array([x, y])
    outline = circle(0.0339)
    inside = outline(pixels(), truth)[0] <= 0
    inside ^= np.random.default_rng(seed).random(len(inside)) < 0.02
    found = fit_outline(outline, pixels(), inside, np.zeros(2), PIXEL)
    assert np.abs(found - truth).max() < 0.4 * PIXEL


@settings(max_examples=40)
@given(offsets, offsets, yaws)
def test_a_digitised_rectangle_is_placed_and_turned(x, y, yaw):
    truth = np.array([x, y, yaw])
    outline = rectangle(0.08, 0.17)
    inside = outline(pixels(), truth)[0] <= 0
    start = guess_rectangle(pixels()[inside], (0.08, 0.17, 0.04))
    found = fit_outline(outline, pixels(), inside, start, PIXEL)
    # Edges along the pixel rows leave a pixel of freedom.
    assert np.abs(found[:2] - truth[:2]).max() < 0.55 * PIXEL
    assert abs(np.sin(found[2] - yaw)) < PIXEL / 0.08


@pytest.mark.parametrize(
    ("outline", "parameters"),
    [(circle(0.03), [0.01, -0.02]), (rectangle(0.06, 0.1), [0.01, -0.02, 0.7])],
)
def test_jacobians_are_the_distances_derivatives(outline, parameters):
    points = np.random.default_rng(3).uniform(-0.1, 0.1, (200, 2))
    parameters = np.array(parameters)
    jacobian = outline(points, parameters)[1]
    for i, step in enumerate(1e-7 * np.eye(len(parameters))):
        plus, minus = (outline(points, parameters + s)[0] for s in (step, -step))
        np.testing.assert_allclose(jacobian[:, i], (plus - minus) / 2e-7, atol=1e-5)


@pytest.mark.parametrize(
    ("shape", "outline"),
    [
        (Cylinder(0.03, 0.1), circle(0.03)),
        (Box((0.06, 0.1, 0.02)), rectangle(0.06, 0.1)),
    ],
)
@pytest.mark.parametrize("grow", [-0.004, 0.0, 0.004])
def test_samples_lie_on_their_outline(shape, outline, grow):
    parameters = np.array([0.01, -0.02, 0.7])
    points = outline_samples(shape, parameters, grow)
    expected = parameters if isinstance(shape, Box) else parameters[:2]
    distance = outline(points, expected)[0]
    # Grown rectangles have corners, farther from the rectangle than their sides.
    assert np.all(np.abs(distance) <= np.sqrt(2) * abs(grow) + 1e-9)
    np.testing.assert_allclose(np.median(distance), grow, atol=1e-9)
