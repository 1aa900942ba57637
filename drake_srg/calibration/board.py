"""The ChArUco board, and its corners in an image."""

from __future__ import annotations

import dataclasses as dc
import functools

import cv2
import numpy as np
import numpy.typing as npt

from drake_srg.types import Vector

# A view with fewer corners is dropped.
MIN_CORNERS = 6


@dc.dataclass(frozen=True)
class Board:
    """A ChArUco board, a chessboard with an ArUco marker in each white square.

    Its frame B is OpenCV's: the origin is the outer corner of the first square, x
    points to the right along the rows, y down the columns, and z into the board, away
    from who looks at it.

    Attributes:
        columns: Squares in a row.
        rows: Squares in a column.
        square: Side of a square [m].
        marker: Side of a marker [m].
        dictionary: Name of the markers' dictionary in `cv2.aruco`.
    """

    columns: int = 6
    rows: int = 5
    square: float = 0.04
    marker: float = 0.03
    dictionary: str = "DICT_4X4_50"

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
        """Return which cells are white; a marker's cell is a sixth of its side wide.

        Returns:
            Shape (rows k, columns k), with k the cells in a side of a square.
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
    return cv2.aruco.CharucoDetector(
        cv2.aruco.CharucoBoard(size, board.square, board.marker, dictionary)
    )


@dc.dataclass(frozen=True)
class Corners:
    """Corners of a board found in an image.

    Attributes:
        p_B: Their places on the board [m], shape (K, 3).
        pixels: Their places in the image, shape (K, 2); the middle of a pixel has whole
            coordinates.
    """

    p_B: Vector
    pixels: Vector


def find_corners(image: npt.NDArray[np.uint8], board: Board) -> Corners:
    """Return the corners of the board that an image shows, all, some or none.

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
