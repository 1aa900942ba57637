import numpy as np

from drake_srg.calibration.board import Board, find_corners

BOARD, PIXELS = Board(), 40


def picture():
    """The board as its own image, 40 pixels to a square, with a white margin."""
    cell = PIXELS * BOARD.columns // BOARD.cells().shape[1]
    image = np.where(np.kron(BOARD.cells(), np.ones((cell, cell))), 255, 0)
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
