import colorsys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.vision.color import COLORS, ColorRange, color_name, color_names


def seen(color_range, *rgb):
    image = np.array([[np.rint(255 * np.array(rgb))]], dtype=np.uint8)
    return bool(color_range.mask(image)[0, 0])


def test_a_hue_range_wraps_through_red():
    red = ColorRange((345.0, 0.3, 0.1), (15.0, 1.0, 1.0))
    assert seen(red, 0.9, 0.1, 0.2)
    assert seen(red, 0.9, 0.2, 0.1)
    assert not seen(red, 0.1, 0.9, 0.1)
    assert not seen(red, 0.1, 0.1, 0.9)


def test_rgb_bounds_are_inclusive():
    lavender = ColorRange((0.8, 0.8, 0.95), (0.9, 0.9, 1.0), "rgb")
    assert seen(lavender, 0.8, 0.9, 1.0)
    assert not seen(lavender, 0.8, 0.9, 0.9)


def test_alpha_is_ignored():
    image = np.array([[[230, 20, 20, 0], [20, 230, 20, 255]]], dtype=np.uint8)
    mask = ColorRange.around((0.9, 0.1, 0.1, 0.5)).mask(image)
    assert mask.tolist() == [[True, False]]


colorful = st.tuples(*[st.floats(0.0, 1.0)] * 3).filter(
    lambda rgb: max(rgb) > 0.4 and max(rgb) - min(rgb) > 0.3 * max(rgb)
)


@given(colorful, st.floats(0.3, 1.0))
def test_shading_keeps_an_object_in_its_range(rgb, shade):
    assert seen(ColorRange.around(rgb), *(shade * x for x in rgb))


@given(colorful)
def test_a_grey_table_is_not_a_colored_object(rgb):
    assert not seen(ColorRange.around(rgb), 0.6, 0.6, 0.6)


def test_grey_objects_are_recognised_by_their_value():
    white = ColorRange.around((0.95, 0.95, 0.95))
    assert seen(white, 0.9, 0.9, 0.9)
    assert not seen(white, 0.4, 0.4, 0.4)
    assert not seen(white, 0.9, 0.3, 0.3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((0, 0, 0), (1, 1, 1), "lab"), "must be 'hsv' or 'rgb', got 'lab'"),
        (((0, 0, 0), (400, 1, 1)), r"'h' must be within 0 .. 360, got \[0, 400\]"),
        (((0, 0.5, 0), (10, 0.4, 1)), "'s'.*lower must not exceed upper"),
        (((0.5, 0, 0), (0.4, 1, 1), "rgb"), "'r'.*lower must not exceed upper"),
    ],
)
def test_bad_ranges_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        ColorRange(*arguments)


def lit(color_range, *rgb):
    image = np.array([[np.rint(255 * np.clip(rgb, 0, 1))]], dtype=np.uint8)
    return bool(color_range.mask_in_any_light(image)[0, 0])


@given(
    st.tuples(st.floats(0.0, 0.15), st.floats(0.0, 0.15)),
    st.sampled_from([(1.0, 0.83, 0.66), (1.0, 1.0, 1.0), (0.82, 0.9, 1.0)]),
    st.floats(0.3, 1.0),
)
def test_a_colour_of_the_range_is_recognised_in_any_light(shift, light, strength):
    lavender = ColorRange((0.75, 0.75, 0.9), (0.95, 0.95, 1.0), "rgb")
    color = np.array([0.75 + shift[0], 0.75 + shift[1], 0.95])
    assert lit(lavender, *(strength * np.array(light) * color))


def test_other_colours_are_rejected_in_any_light():
    red = ColorRange.around((0.8, 0.1, 0.08))
    for light in ((1.0, 0.83, 0.66), (0.82, 0.9, 1.0)):
        assert lit(red, *(np.array(light) * (0.7, 0.1, 0.1)))
        assert not lit(red, *(np.array(light) * (0.1, 0.7, 0.1)))
        assert not lit(red, *(np.array(light) * (0.8, 0.8, 0.8)))
    assert not lit(red, 0.05, 0.01, 0.01)  # black


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
