import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import (
    ClutterConfig,
    ColorRangeConfig,
    ObjectConfig,
    OcclusionConfig,
    SoftConfig,
)
from drake_srg.scenario.typed_yaml import load_typed, parse_yaml


def load(schema, text):
    return load_typed(schema, parse_yaml(text, "f"), "f")


def test_the_default_foam_follows_from_its_density():
    # Open cells: the solid's modulus times the square of the relative density.
    assert SoftConfig().youngs_modulus == pytest.approx(45e6 * (30 / 1200) ** 2, 0.01)


def test_every_number_of_a_model_can_be_kept():
    text = "{model: m.sdf, mass: null, friction: null, resolution: null, modulus: null}"
    assert load(ObjectConfig, text) == ObjectConfig(model="m.sdf")


def test_kinds_of_clutter_are_objects():
    text = "{count: 2, kinds: {box: {shape: !Box {}, mass: 0.1, friction: 0.5}}}"
    clutter = load(ClutterConfig, text)
    assert clutter.count == 2
    assert isinstance(clutter.kinds["box"], ObjectConfig)


@pytest.mark.parametrize(
    ("schema", "text", "message"),
    [
        (ObjectConfig, "mass: 0", "mass: must be greater than 0.0"),
        (ObjectConfig, "friction: -0.1", "friction: must be at least 0.0"),
        (ObjectConfig, "modulus: 0", "modulus: must be greater than 0.0"),
        (ObjectConfig, "known_scale: 0", "known_scale: must be greater than 0.0"),
        (ObjectConfig, "color: [0.1, 0.2]", "color: needs 3 numbers, got 2"),
        (ObjectConfig, "color: [0, 0, 1.1]", "color: must be at most 1.0, got 1.1"),
        (ObjectConfig, "position: [1, 2, 3]", "position: needs 2 numbers, got 3"),
        (ColorRangeConfig, "space: cmyk", "space: must be one of hsv, rgb"),
        (ColorRangeConfig, "lower: [1, 2]", "lower: needs 3 numbers"),
        (OcclusionConfig, "share: 1.5", "share: must be at most 1.0"),
        (SoftConfig, "youngs_modulus: 0", "youngs_modulus: must be greater than 0.0"),
        (SoftConfig, "poissons_ratio: 0.5", "poissons_ratio: must be at most 0.45"),
        (ClutterConfig, "count: -1", "count: must be at least 0"),
    ],
)
def test_bad_values_are_refused(schema, text, message):
    with pytest.raises(ScenarioError) as error:
        load(schema, text)
    assert str(error.value).startswith(f"f: {message}")
