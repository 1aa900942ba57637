"""The ChArUco board."""

import numpy as np
from pydrake.geometry import Role

from drake_srg.robot.calibrate.mounting import Board
from models.built_models import build


def test_its_frame_is_that_of_the_calibration():
    built = build("charuco_board")
    board = built.plant.GetBodyByName("board")
    center = board.CalcCenterOfMassInBodyFrame(built.plant_context)
    np.testing.assert_allclose(center[:2], Board().center[:2], atol=1e-6)
    assert center[2] > 0.0  # the sheet is behind the face
    assert not built.shapes(board, Role.kProximity)
