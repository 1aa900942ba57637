import numpy as np
import pytest
from pydrake.multibody.parsing import GetScopedFrameByName

from drake_srg.calibration.board import Board
from drake_srg.calibration.mounting import MODEL, mount, with_board
from drake_srg.cell.planners import own_scene
from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import MakeModelsPlant


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
