import dataclasses as dc

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from calibration.test_board import picture
from drake_srg.calibration.board import Board
from drake_srg.calibration.mounting import mount
from drake_srg.calibration.shots import Shot, find_views, read_shots, shot_files
from drake_srg.cell.planners import own_scene
from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario


@pytest.fixture(scope="module")
def mounting():
    size = [
        f"cameras.ceiling.{side}={n}" for side, n in (("width", 320), ("height", 280))
    ]
    scenario = load_scenario("assistive_arm", overrides=size)
    return mount(scenario, "ceiling", own_scene(scenario), Board())


def shots(*images):
    return [
        Shot(
            f"{i}.png",
            image,
            RigidTransform(RollPitchYaw(0.1 * i, 0.2, 0.3), [i, 0, 0]),
        )
        for i, image in enumerate(images)
    ]


def write(folder, files):
    for name, data in files.items():
        (folder / name).write_bytes(data)
    return folder


def test_a_folder_gives_back_what_was_written(tmp_path):
    color = np.random.default_rng(0).integers(0, 255, (6, 8, 3)).astype(np.uint8)
    taken = shots(color, color[::-1])
    for before, after in zip(
        taken, read_shots(write(tmp_path, shot_files(taken))), strict=True
    ):
        assert after.name == before.name
        np.testing.assert_array_equal(after.image, before.image)
        assert after.X_WH.IsNearlyEqualTo(before.X_WH, 1e-8)


def test_a_spreadsheet_s_byte_order_mark_is_passed_over(tmp_path):
    files = shot_files(shots(np.zeros((6, 8, 3), np.uint8)))
    files["poses.csv"] = b"\xef\xbb\xbf" + files["poses.csv"]
    (shot,) = read_shots(write(tmp_path, files))
    assert shot.name in files


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("poses.csv", None, None, "poses.csv: cannot be read: No such file"),
        ("poses.csv", b"qw", b"w", "missing column qw"),
        (
            "poses.csv",
            b",0.000000000,",
            b",here,",
            "row 2: .: must be a number, got 'here'",
        ),
        ("poses.csv", b"0.000000000,0.98", b"0.000000000,0.08", "must have norm 1"),
        ("1.png", None, None, "row 3: image '1.png' cannot be read"),
        ("1.png", b"PNG", b"JPG", "row 3: image '1.png' cannot be read"),
    ],
)
def test_a_bad_folder_gets_one_line(tmp_path, name, old, new, message):
    files = shot_files(shots(*[np.zeros((6, 8, 3), np.uint8)] * 2))
    if old is None:
        del files[name]
    else:
        assert old in files[name]
        files[name] = files[name].replace(old, new, 1)
    with pytest.raises(ScenarioError, match=message) as caught:
        read_shots(write(tmp_path, files))
    assert "\n" not in str(caught.value)


def test_corners_are_found_in_each_image(mounting):
    hidden = picture()
    hidden[:, 160:] = 128
    views = find_views(shots(picture(), hidden), mounting)
    assert [view.name for view in views] == ["0.png", "1.png"]
    assert len(views[0].pixels) == 20 > len(views[1].pixels) > 0
    # A fixed camera in the world: the board's mount is the hand.
    assert views[1].X_PQ.IsExactlyEqualTo(shots(0, 0)[1].X_WH)
    moving = dc.replace(mounting, in_hand=True)
    views = find_views(shots(picture(), hidden), moving)
    assert views[1].X_PQ.IsExactlyEqualTo(shots(0, 0)[1].X_WH.inverse())


@pytest.mark.parametrize(
    ("images", "message"),
    [
        ((picture(), picture()), "1.png: same image as 0.png, but the hand has moved"),
        ((picture()[:100],), "0.png: image has 320 x 100 pixels .allowed: 320 x 280"),
        ((np.zeros((280, 320), np.uint8),), "none of 1 images shows the board"),
    ],
)
def test_images_that_cannot_be_used_are_refused(mounting, images, message):
    with pytest.raises(ScenarioError, match=message):
        find_views(shots(*images), mounting)
