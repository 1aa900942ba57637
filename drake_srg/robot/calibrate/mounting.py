"""The ChArUco board in an image, and where camera and board are mounted."""

from __future__ import annotations

import dataclasses as dc
import functools

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.common.schema import Transform
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import (
    AddModel,
    AddWeld,
    GetScopedFrameByName,
    ModelDirective,
)

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ClutterConfig
from drake_srg.planning.motion.arm_model import ArmModel
from drake_srg.scenario import LocalizerConfig, RecordingConfig, Scenario, TaskConfig
from drake_srg.types import Vector
from drake_srg.vision.camera import CameraModel

# A view with fewer corners is dropped.
MIN_CORNERS = 6


@dc.dataclass(frozen=True)
class Board:
    """A ChArUco board, a chessboard with an ArUco marker in each white square.

    Its frame B is OpenCV's: the origin is the outer corner of the first square, x
    points to the right along the rows, y down the columns, and z into the board, away
    from the viewer.

    Attributes:
        columns: Squares in a row.
        rows: Squares in a column.
        square: Side of a square [m].
        marker: Side of a marker [m].
        dictionary: Name of the markers' dictionary in `cv2.aruco`.
        legacy: Whether the board was made by OpenCV before 4.6: with an even number of
            rows, it starts with a white square.
    """

    columns: int = 6
    rows: int = 5
    square: float = 0.04
    marker: float = 0.03
    dictionary: str = "DICT_4X4_50"
    legacy: bool = False

    @property
    def size(self) -> Vector:
        """Width and height [m], shape (2,)."""
        return self.square * np.array([self.columns, self.rows])

    @property
    def center(self) -> Vector:
        """The middle of the board in B [m], shape (3,)."""
        return np.array([*0.5 * self.size, 0.0])

    @property
    def corners(self) -> Vector:
        """The inner corners of the squares in B [m], shape ((c - 1) (r - 1), 3)."""
        return np.array(self.detector.getBoard().getChessboardCorners(), dtype=float)

    def cells(self) -> npt.NDArray[np.bool_]:
        """Return which cells are white. A cell's side is a sixth of a marker's.

        Returns:
            Array of shape (rows k, columns k), with k cells along a square's side.
        """
        k = round(6 * self.square / self.marker)
        size = (k * self.columns, k * self.rows)
        image = self.detector.getBoard().generateImage(size, marginSize=0)
        return np.asarray(image > 0)

    @property
    def detector(self) -> cv2.aruco.CharucoDetector:
        """OpenCV's detector of this board."""
        return _detector(self)


@functools.cache
def _detector(board: Board) -> cv2.aruco.CharucoDetector:
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    size = (board.columns, board.rows)
    made = cv2.aruco.CharucoBoard(size, board.square, board.marker, dictionary)
    made.setLegacyPattern(board.legacy)
    return cv2.aruco.CharucoDetector(made)


@dc.dataclass(frozen=True)
class Corners:
    """Corners of a board found in an image.

    Attributes:
        p_B: Their places on the board [m], shape (K, 3).
        pixels: Their places in the image, shape (K, 2). Pixel centers have whole
            coordinates.
    """

    p_B: Vector
    pixels: Vector


def find_corners(image: npt.NDArray[np.uint8], board: Board) -> Corners:
    """Return the corners of the board that an image shows; there may be none.

    Args:
        image: Grey (height, width) or RGB (height, width, 3).
        board: The board.
    """
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    pixels, ids, _, _ = board.detector.detectBoard(grey)
    if ids is None:
        return Corners(np.zeros((0, 3)), np.zeros((0, 2)))
    found = np.asarray(ids).ravel()
    return Corners(board.corners[found], np.array(pixels, float).reshape(-1, 2))


MODEL = "charuco_board"
_PALM = "gripper::palm"
# A fixed camera sees the board on posts above the palm, like a tray. The board's rows
# run along the fingers, and its face points along the palm's z axis. This is the
# board's middle in the palm's frame [m].
_TRAY = np.array([0.12, 0.0, 0.08])
THICKNESS = 0.005  # of the board [m]


@dc.dataclass(frozen=True)
class Mounting:
    """A camera and a board; one of them is mounted on the hand.

    Attributes:
        model: The camera's configured intrinsics.
        X_PB: Configured pose of the camera's body in its base frame P [m].
        base_frame: Name of P.
        in_hand: Whether the arm moves the camera; otherwise it moves the board.
        X_WP: Pose of P in the world, for a fixed camera [m].
        X_QO: Pose of the board in its mount Q, as placed by `with_board` [m].
    """

    camera: str
    model: CameraModel
    X_PB: RigidTransform
    base_frame: str
    in_hand: bool
    X_WP: RigidTransform
    board: Board
    X_QO: RigidTransform

    @property
    def hand_frame(self) -> str:
        """Name of the moving frame H, whose pose differs from view to view."""
        return self.base_frame if self.in_hand else _PALM

    def X_PQ(self, X_WH: RigidTransform) -> RigidTransform:
        """Return the pose of the board's mount in the camera's for a hand pose [m]."""
        return X_WH.inverse() if self.in_hand else self.X_WP.inverse() @ X_WH

    @property
    def focal(self) -> Vector:
        """Configured focal lengths [pixels], shape (2,)."""
        info = self.model.color
        return np.array([info.focal_x(), info.focal_y()])

    @property
    def center(self) -> Vector:
        """Configured principal point [pixels], (2,); pixel centers are whole."""
        info, shift = self.model.color, self.model.pixel_center
        return np.array([info.center_x() - shift, info.center_y() - shift])

    def X_WH(self, arm: ArmModel, q: Vector) -> RigidTransform:
        """Return the pose of H in the world with the arm at `q` [m]."""
        arm.plant.SetPositions(arm.context, arm.positions(q))
        frame = GetScopedFrameByName(arm.plant, self.hand_frame)
        return frame.CalcPoseInWorld(arm.context)


def mount(scenario: Scenario, camera: str, arm: ArmModel, board: Board) -> Mounting:
    """Return how a scenario's camera and the board are mounted.

    Args:
        scenario: The scenario.
        camera: Name of the camera.
        arm: The scenario's arm.
        board: The board.

    Raises:
        ScenarioError: If there is no such camera or base frame.
    """
    if camera not in scenario.cameras:
        allowed = ", ".join(scenario.cameras) or "none"
        raise ScenarioError(f"--camera: unknown camera {camera!r} (allowed: {allowed})")
    config = scenario.cameras[camera]
    name = config.X_PB.base_frame or "world"
    try:
        frame = GetScopedFrameByName(arm.plant, name)
    except RuntimeError:
        key = f"cameras.{camera}.X_PB.base_frame"
        raise ScenarioError(f"{key}: unknown frame {name!r}") from None
    poses = []
    for q in (arm.lower, arm.upper):
        arm.plant.SetPositions(arm.context, arm.positions(q))
        poses.append(frame.CalcPoseInWorld(arm.context))
    in_hand = not poses[0].IsNearlyEqualTo(poses[1], 1e-9)
    return Mounting(
        camera=camera,
        model=CameraModel.from_config(config),
        X_PB=config.X_PB.GetDeterministicValue(),
        base_frame=name,
        in_hand=in_hand,
        X_WP=poses[0],
        board=board,
        X_QO=_on_table(scenario, board) if in_hand else _on_hand(board),
    )


def with_board(scenario: Scenario, mounting: Mounting) -> Scenario:
    """Return the scenario with the board and only this camera, without objects."""
    pose = Transform(mounting.X_QO)
    weld = AddWeld(
        parent="world" if mounting.in_hand else _PALM, child=f"{MODEL}::board"
    )
    weld.X_PC = pose
    model = AddModel(file=f"package://drake_srg/sdf/{MODEL}.sdf", name=MODEL)
    board = [ModelDirective(add_model=model), ModelDirective(add_weld=weld)]
    return dc.replace(
        scenario,
        directives=[*scenario.directives, *board],
        cameras={mounting.camera: scenario.cameras[mounting.camera]},
        objects={},
        clutter=ClutterConfig(),
        sleeping=None,
        disturbances=[],
        task=TaskConfig(),
        localizer=LocalizerConfig(),
        recording=RecordingConfig(),
    )


def _on_hand(board: Board) -> RigidTransform:
    # Rows along the fingers, face up: O's z points into the board, to the palm.
    R_GO = RotationMatrix(np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]]))
    return RigidTransform(R_GO, _TRAY) @ RigidTransform(-board.center)


def _on_table(scenario: Scenario, board: Board) -> RigidTransform:
    """Return the pose of the board that lies in the middle of the task's region."""
    area = scenario.task.region
    if np.allclose(area.min, area.max):
        area = scenario.table
    x, y = 0.5 * (np.array(area.min) + np.array(area.max))
    top = np.array([x, y, scenario.table.height + THICKNESS])
    R_WO = RotationMatrix.MakeXRotation(np.pi)
    return RigidTransform(R_WO, top) @ RigidTransform(-board.center)
