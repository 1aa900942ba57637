import numpy as np
import pytest
from pydrake.multibody.parsing import GetScopedFrameByName

from drake_srg.common.exceptions import ScenarioError
from drake_srg.robot.calibrate.mounting import (
    MODEL,
    Board,
    find_corners,
    mount,
    with_board,
)
from drake_srg.scenario import load_scenario
from drake_srg.station.planners import own_scene
from drake_srg.station.plant import MakeModelsPlant

BOARD, PIXELS = Board(), 40


def picture(board=BOARD):
    """The board as its own image, 40 pixels to a square, with a white margin."""
    cell = PIXELS * board.columns // board.cells().shape[1]
    image = np.where(np.kron(board.cells(), np.ones((cell, cell))), 255, 0)
    below = PIXELS * (BOARD.rows - board.rows)
    image = np.pad(image, ((0, below), (0, 0)), constant_values=255)
    return np.pad(image.astype(np.uint8), PIXELS, constant_values=255)


def test_it_has_a_corner_between_any_four_squares():
    assert len(BOARD.corners) == 5 * 4
    np.testing.assert_allclose(BOARD.corners[0], [0.04, 0.04, 0.0], atol=1e-9)
    np.testing.assert_allclose(BOARD.center, [0.12, 0.10, 0.0])


def test_all_corners_are_found_where_they_are():
    found = find_corners(picture(), BOARD)
    np.testing.assert_allclose(found.p_B, BOARD.corners)
    expected = found.p_B[:, :2] / BOARD.square * PIXELS + PIXELS - 0.5
    np.testing.assert_allclose(found.pixels, expected, atol=0.05)


def test_a_half_hidden_board_shows_the_corners_of_its_other_half():
    image = picture()
    image[:, : image.shape[1] // 2] = 128
    found = find_corners(np.repeat(image[:, :, None], 3, axis=2), BOARD)
    assert 6 <= len(found.pixels) < len(BOARD.corners)
    assert found.p_B[:, 0].min() > BOARD.center[0] - BOARD.square


def test_an_image_without_a_board_shows_none():
    assert find_corners(np.full((48, 64), 128, np.uint8), BOARD).p_B.shape == (0, 3)


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("kitchen_hand_camera")


@pytest.fixture(scope="module")
def scene(scenario):
    return own_scene(scenario)


@pytest.mark.parametrize("camera", ["ceiling", "hand"])
def test_camera_and_board_are_on_two_sides_of_the_arm(scenario, scene, camera):
    mounting = mount(scenario, camera, scene, Board())
    assert mounting.in_hand == (camera == "hand")
    plant = MakeModelsPlant(with_board(scenario, mounting))
    context = plant.CreateDefaultContext()
    q = np.array(scenario.arm.home) + 0.1
    plant.SetPositions(context, plant.GetModelInstanceByName("arm"), q)
    frames = (mounting.base_frame, f"{MODEL}::board")
    X_WP, X_WO = (
        GetScopedFrameByName(plant, name).CalcPoseInWorld(context) for name in frames
    )
    X_PQ = mounting.X_PQ(mounting.X_WH(scene, q))
    assert (X_WP @ X_PQ @ mounting.X_QO).IsNearlyEqualTo(X_WO, 1e-9)


def test_the_board_lies_on_the_table_face_up(scenario, scene):
    mounting = mount(scenario, "hand", scene, Board())
    middle = mounting.X_QO @ mounting.board.center
    np.testing.assert_allclose(middle, [0.6, 0.0, 0.005], atol=1e-9)
    np.testing.assert_allclose(mounting.X_QO.rotation().col(2), [0, 0, -1], atol=1e-9)


def test_only_the_board_is_added(scenario, scene):
    board = with_board(scenario, mount(scenario, "hand", scene, Board()))
    assert list(board.cameras) == ["hand"]
    assert not board.objects
    assert scenario.objects


def test_unknown_cameras_and_frames_are_refused(scenario, scene):
    with pytest.raises(
        ScenarioError, match=r"--camera: unknown camera 'eye' .*ceiling"
    ):
        mount(scenario, "eye", scene, Board())
    wrong = load_scenario(
        "kitchen", overrides=["cameras.ceiling.X_PB.base_frame=nothing::here"]
    )
    with pytest.raises(
        ScenarioError, match="base_frame: unknown frame 'nothing::here'"
    ):
        mount(wrong, "ceiling", scene, Board())
