import dataclasses as dc
import logging
import struct
import zlib

import numpy as np
import pytest
from helpers import check_reads_or_refuses, damaged
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.common.exceptions import ScenarioError
from drake_srg.robot.calibrate.mounting import Board, mount
from drake_srg.robot.calibrate.shots import (
    Shot,
    find_views,
    plan_visits,
    read_shots,
    shot_files,
)
from drake_srg.robot.calibrate.solve import Unknowns, View, project
from drake_srg.scenario import load_scenario
from drake_srg.station.planners import own_scene
from robot.calibrate.test_mounting import picture


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


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("poses.csv", None, None, "poses.csv: cannot be read: No such file"),
        ("poses.csv", b"qw", b"w", "missing column qw"),
        (
            "poses.csv",
            b",0.000000000,",
            b",here,",
            "line 2: .: must be a number, got 'here'",
        ),
        ("poses.csv", b"0.000000000,0.98", b"0.000000000,0.08", "must have norm 1"),
        ("1.png", None, None, "line 3: image '1.png' cannot be read"),
        ("1.png", b"PNG", b"JPG", "line 3: image '1.png' cannot be read"),
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


def test_a_picture_of_too_many_pixels_is_refused(tmp_path):
    files = shot_files(shots(np.zeros((6, 8, 3), np.uint8)))
    start = files["0.png"][:16]
    head = b"IHDR" + struct.pack(">IIBBBBB", 10**5, 10**5, 8, 2, 0, 0, 0)
    crc = struct.pack(">I", zlib.crc32(head))
    files["0.png"] = start[:12] + head + crc + files["0.png"][33:]
    with pytest.raises(ScenarioError, match=r"image '0\.png' cannot be read"):
        read_shots(write(tmp_path, files))


def test_a_board_of_an_older_opencv_is_found_and_told(mounting, caplog):
    """The pattern of a board with an even number of rows differs."""
    board = dc.replace(mounting.board, rows=4)
    old = dc.replace(board, legacy=True)
    taken = shots(picture(old), np.roll(picture(old), 5))
    with caplog.at_level(logging.WARNING, logger="drake_srg"):
        views = find_views(taken, dc.replace(mounting, board=board))
    assert "OpenCV before 4.6" in caplog.text
    expected = old.corners[:, :2] / old.square * 40 + 40 - 0.5
    np.testing.assert_allclose(views[0].pixels, expected, atol=0.05)
    caplog.clear()
    find_views(shots(picture(board)), dc.replace(mounting, board=board))
    assert not caplog.records


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


def plan(name, camera, overrides=(), count=5):
    scenario = load_scenario(name, overrides=overrides)
    scene = own_scene(scenario)
    mounting = mount(scenario, camera, scene, Board())
    home = np.array(scenario.arm.home)
    return mounting, scene, home, plan_visits(mounting, scene, home, count, seed=0)


@pytest.mark.parametrize(
    ("name", "camera"), [("kitchen", "ceiling"), ("kitchen_hand_camera", "hand")]
)
def test_the_camera_sees_the_board_from_every_posture(name, camera):
    mounting, scene, home, paths = plan(name, camera)
    X_PC = mounting.X_PB @ mounting.model.X_BC
    truth = Unknowns(mounting.focal, mounting.center, X_PC, mounting.X_QO)
    at = home
    for path in paths:
        np.testing.assert_array_equal(path[0], at)
        at = path[-1]
        assert all(scene.is_free(q) for q in path)
        X_PQ = mounting.X_PQ(mounting.X_WH(scene, at))
        middle = View("", X_PQ, mounting.board.center[None], np.zeros((1, 2)))
        u, v = project(truth, middle)[0]
        assert 0.0 < u < 640.0
        assert 0.0 < v < 480.0
        X_CO = X_PC.inverse() @ X_PQ @ mounting.X_QO
        assert X_CO.rotation().matrix()[2, 2] > 0.5  # its face is turned to the camera


def test_images_too_small_for_the_markers_are_refused():
    small = ["cameras.ceiling.width=160", "cameras.ceiling.height=120"]
    with pytest.raises(ScenarioError, match=r"cameras.ceiling: .* 160 x 120 pixels"):
        plan("kitchen", "ceiling", small, count=1)


def test_a_camera_that_the_arm_cannot_reach_is_refused():
    away = ["cameras.ceiling.X_PB.translation=[5.0, 0.0, 1.55]"]
    with pytest.raises(
        ScenarioError, match=r"cameras.ceiling: the arm can .* only 0 of 1 postures"
    ):
        plan("kitchen", "ceiling", away, count=1)


@pytest.mark.parametrize("name", ["poses.csv", "0.png"])
@settings(max_examples=50)
@given(data=st.data())
def test_a_broken_file_gets_one_line(tmp_path_factory, name, data):
    files = shot_files(shots(np.full((6, 8, 3), 90, np.uint8)))
    files[name] = data.draw(damaged(files[name]))
    folder = write(tmp_path_factory.mktemp("shots"), files)
    check_reads_or_refuses(lambda _: read_shots(folder), folder / "poses.csv")
