import numpy as np
import pytest
from pydrake.common.schema import Transform
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import (
    HOUSEHOLD,
    contact_sheet,
    household_object,
    object_facts,
    take_portrait,
)
from drake_srg.objects.models import simple_shape
from drake_srg.types import Box, Cylinder, Sphere

# Extents [mm] along x, y, z and mass [g] of the numbered objects in the table of the
# YCB set, except for the four whose sizes drake_models measured: 003, 004, 005, 056.
YCB = {
    "003_cracker_box": ([158, 207.4, 65.8], 411),
    "004_sugar_box": ([86.7, 170.3, 39.1], 514),
    "005_tomato_soup_can": ([67.8, 67.8, 101.8], 349),
    "007_tuna_can": ([85, 85, 33], 171),
    "008_pudding_box": ([110, 89, 35], 187),
    "010_potted_meat_can": ([50, 97, 82], 370),
    "011_banana": ([None, 190, 36], 66),
    "019_pitcher_base": ([None, 108, 235], 178),
    "029_plate": ([258, 258, 24], 279),
    "031_spoon": ([195, None, 14], 30),
    "036_wood_block": ([85, 85, 200], 729),
    "040_large_marker": ([18, 18, 121], 15.8),
    "043_phillips_screwdriver": ([215, 31, 31], 97),
    "048_hammer": ([None, 135, 32], 665),
    "056_tennis_ball": ([65, 65, 65], 58),
    "061_foam_brick": ([75, 50, 50], 28),
}
SIMPLE = {"003": Box, "004": Box, "005": Cylinder, "007": Cylinder, "008": Box}
SIMPLE |= {"036": Box, "040": Cylinder, "056": Sphere, "061": Box}


@pytest.mark.parametrize("name", YCB)
def test_sizes_and_masses_are_those_of_the_ycb_set(name):
    sides, mass = YCB[name]
    facts = object_facts(name, household_object(name))
    for side, found in zip(sides, 1e3 * facts.size, strict=True):
        # Hulls may stand out by 2 mm on either side.
        assert side is None or found == pytest.approx(side, abs=4.0)
    assert 1e3 * facts.mass == pytest.approx(mass, abs=1e-3)


@pytest.mark.parametrize("name", HOUSEHOLD)
def test_the_localizer_knows_the_simple_ones(name):
    shape = simple_shape(name, household_object(name))
    if expected := SIMPLE.get(name[:3]):
        assert isinstance(shape, expected)
        np.testing.assert_allclose(
            shape.bounding_size, object_facts(name, household_object(name)).size
        )
    else:
        assert shape is None


@pytest.mark.parametrize("name", HOUSEHOLD)
def test_each_stands_on_its_origin_or_around_it(name):
    facts = object_facts(name, household_object(name))
    shape = simple_shape(name, household_object(name))
    bottom = 0.0 if shape is None else -0.5 * shape.height
    assert facts.low[2] == pytest.approx(bottom, abs=1e-6)


@pytest.mark.parametrize("name", [n for n in YCB if n[:3] not in SIMPLE])
def test_pieces_are_few(name):
    assert object_facts(name, household_object(name)).pieces <= 21


@pytest.mark.parametrize("shape", [Box([0.1, 0.2, 0.3]), Cylinder(0.03, 0.1)])
def test_facts_of_a_shape(shape):
    config = ObjectConfig(shape=shape, mass=0.3, friction=0.5)
    config.pose = Transform(RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [1, 2, 3]))
    facts = object_facts("thing", config)
    np.testing.assert_allclose(facts.size, shape.bounding_size)
    assert (facts.mass, facts.pieces) == (0.3, 1)


@pytest.mark.parametrize("shape", [Sphere(0.03), Box([0.3, 0.01, 0.1])])
def test_the_object_is_wholly_in_the_picture(shape):
    config = ObjectConfig(shape=shape, mass=0.1, friction=0.5, color=[0.9, 0.1, 0.1])
    image = take_portrait("thing", config, 96)
    assert image.shape == (96, 96, 3)
    border = np.vstack([image[0], image[-1], image[:, 0], image[:, -1]])
    assert np.all(border == 255)
    seen = np.any(image < 250, axis=2)
    assert 0.02 < seen.mean() < 0.8
    red = image[seen].mean(axis=0)
    assert red[0] > 1.5 * max(red[1:])


def test_a_sheet_has_rows_of_pictures_with_names():
    pictures = {f"p{i}": np.full((50, 80, 3), 10 * i, np.uint8) for i in range(9)}
    sheet = contact_sheet(pictures)
    assert sheet.shape[1:] == (400, 3)
    assert sheet.shape[0] % 2 == 0
    assert np.all(sheet[:50, 80:160] == 10)
    assert np.any(sheet[50 : sheet.shape[0] // 2, :80] < 200)  # the name
    assert np.all(sheet[-50:, 320:] == 255)  # the last place is empty
