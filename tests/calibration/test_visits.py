import numpy as np
import pytest

from drake_srg.calibration.board import Board
from drake_srg.calibration.mounting import mount
from drake_srg.calibration.projection import Unknowns, View, project
from drake_srg.calibration.visits import plan_visits
from drake_srg.cell.planners import own_scene
from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario


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
        ScenarioError, match=r"cameras.ceiling: the arm can .* 0 of 1 w"
    ):
        plan("kitchen", "ceiling", away, count=1)
