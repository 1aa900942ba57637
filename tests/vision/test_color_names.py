import colorsys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.vision.color_names import COLORS, color_name, color_names


@pytest.mark.parametrize(
    ("rgb", "name"),
    [
        ((0.8, 0.1, 0.1), "red"),
        ((0.8, 0.05, 0.12), "red"),  # on the other side of 0 degrees
        ((0.9, 0.5, 0.1), "orange"),
        ((0.9, 0.85, 0.1), "yellow"),
        ((0.1, 0.6, 0.2), "green"),
        ((0.1, 0.8, 0.8), "cyan"),
        ((0.1, 0.2, 0.7), "blue"),
        ((0.5, 0.2, 0.8), "purple"),
        ((0.9, 0.3, 0.7), "pink"),
        ((0.95, 0.93, 0.9), "white"),
        ((0.5, 0.5, 0.52), "grey"),
        ((0.05, 0.05, 0.04), "black"),
        ((0.1, 0.0, 0.0), "black"),  # too dark to tell
    ],
)
def test_names(rgb, name):
    assert color_name(rgb) == name


@given(st.floats(0.0, 1.0), st.floats(0.5, 1.0), st.floats(0.4, 1.0))
def test_shade_does_not_change_a_hue(hue, saturation, light):
    bright, shaded = (
        np.array(colorsys.hsv_to_rgb(hue, saturation, value)) for value in (1.0, light)
    )
    # 8 bits move a hue by up to 2 degrees.
    near = {
        color_name(colorsys.hsv_to_rgb((hue + turn) % 1.0, saturation, 1.0))
        for turn in (-0.006, 0.0, 0.006)
    }
    assert color_name(bright) in near
    assert color_name(shaded) in near


@given(st.lists(st.integers(0, 255), min_size=3, max_size=3))
def test_an_image_has_the_names_of_its_pixels(pixel):
    image = np.full((2, 3, 4), [*pixel, 255], np.uint8)
    names = color_names(image)
    assert names.shape == (2, 3)
    assert {COLORS[i] for i in names.ravel()} == {color_name(np.array(pixel) / 255.0)}
