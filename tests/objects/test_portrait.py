import numpy as np
import pytest

from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.portrait import contact_sheet, take_portrait
from drake_srg.types import Box, Sphere


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
    pictures = {f"p{i}": np.full((50, 80, 3), 10 * i, np.uint8) for i in range(5)}
    sheet = contact_sheet(pictures, across=2)
    assert sheet.shape[1:] == (160, 3)
    assert sheet.shape[0] % 3 == 0
    assert np.all(sheet[:50, 80:] == 10)
    assert np.any(sheet[50 : sheet.shape[0] // 3, :80] < 200)  # the name
    assert np.all(sheet[-50:, 80:] == 255)  # the last place is empty
