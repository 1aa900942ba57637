import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeStation

RED = [0.8, 0.1, 0.08]


def red_pixels(*overrides, seed=0):
    """Return where the ceiling camera sees the kitchen's can, shape (240, 320)."""
    fixed = (
        "object.model=null",
        "object.shape=!Cylinder {radius: 0.034, length: 0.01}",
        f"object.color={RED}",
    )
    scenario = load_scenario("kitchen", seed=seed, overrides=[*fixed, *overrides])
    station = MakeStation(scenario)
    image = station.GetOutputPort("camera_ceiling.color_image")
    pixels = image.Eval(station.CreateDefaultContext()).data[..., :3].astype(float)
    return (pixels[..., 0] > 2.0 * pixels[..., 1]) & (pixels[..., 0] > 40.0)


@pytest.fixture(scope="module")
def whole():
    """Where the camera sees the can without a card."""
    return red_pixels()


@pytest.mark.slow
@given(share=st.floats(0.05, 0.95), direction=st.floats(0.0, 6.28))
@settings(max_examples=6)
def test_a_card_hides_its_share_of_the_width(whole, share, direction):
    seen = red_pixels(f"object.occlusion={{share: {share}, direction: {direction}}}")
    # Pixels on the rim mix with their neighbours.
    assert not np.any(seen & (cv2.dilate(whole.astype(np.uint8), np.ones((3, 3))) == 0))
    v, u = np.nonzero(whole)
    # World's x points up in the image, and its y to the left.
    along = np.array([-np.sin(direction), -np.cos(direction)]) @ [u, v]
    width = along.max() - along.min()
    along_seen = along[seen[v, u]]
    hidden = (along.max() - along_seen.max()) / width
    assert along_seen.min() - along.min() < 2.0  # nothing on the other side
    # One pixel on either side of an edge, and one for the slanted view.
    assert abs(hidden - share) < 3.0 / width


@pytest.mark.slow
def test_a_share_of_zero_hides_nothing(whole):
    np.testing.assert_array_equal(red_pixels("object.occlusion={share: 0.0}"), whole)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("localizer.cameras=[]", "needs at least one camera in localizer.cameras"),
        (
            "cameras.ceiling.X_PB.base_frame=arm::flange",
            "needs a first localizer camera that is fixed in world, got",
        ),
    ],
)
def test_errors_name_the_key(override, message):
    with pytest.raises(ScenarioError, match=f"objects.soup_can.occlusion: {message}"):
        red_pixels("object.occlusion={share: 0.5}", override)
