import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.robot.calibrate.solve import (
    NUM_PARAMETERS,
    calibrate,
    jacobian,
    project,
)
from robot.calibrate.helpers import BOARD, CENTER, FOCAL, make_views, pose, truth

angles = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3)
places = st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3)


@given(angles, places, angles, places)
@settings(max_examples=20)
def test_the_derivatives_are_those_of_the_projection(rpy_c, p_c, rpy_b, p_b):
    camera = truth(pose(rpy_c, p_c), pose(rpy_b, p_b))
    (view,) = make_views(camera, count=1)
    expected = np.zeros((len(view.p_B), 2, NUM_PARAMETERS))
    for i in range(NUM_PARAMETERS):
        step = np.zeros(NUM_PARAMETERS)
        step[i] = 1e-5
        ahead, behind = camera.moved(step), camera.moved(-step)
        expected[:, :, i] = (project(ahead, view) - project(behind, view)) / 2e-5
    np.testing.assert_allclose(jacobian(camera, view), expected, rtol=1e-4, atol=1e-3)


def test_a_point_on_the_axis_is_at_the_principal_point():
    camera = truth(pose([0, 0, 0], [0, 0, 0]), pose([0, 0, 0], [0, 0, 0]))
    (view,) = make_views(camera, count=1)
    lone = type(view)("", pose([0, 0, 0], [0, 0, 1.0]), np.zeros((1, 3)), view.pixels)
    np.testing.assert_allclose(project(camera, lone)[0], camera.center)


CAMERA = truth(
    pose([0.1, -3.0, 0.4], [0.2, 0.1, 1.2]), pose([3.1, 0, 0.2], [0.1, 0, 0])
)


def off(result, camera):
    """Distance [m] and angle [rad] between the estimated and the true camera."""
    X_CE = camera.X_PC.inverse() @ result.estimate.X_PC
    turn = X_CE.rotation().ToAngleAxis().angle()
    return float(np.linalg.norm(X_CE.translation())), float(turn)


@given(angles, places, angles, places, st.integers(0, 99), st.floats(-0.1, 0.1))
@settings(max_examples=15)
def test_exact_corners_recover_any_camera(rpy_c, p_c, rpy_b, p_b, seed, wrong):
    camera = truth(pose(rpy_c, p_c), pose(rpy_b, p_b))
    views = make_views(camera, count=8, seed=seed)
    result = calibrate(views, FOCAL * (1.0 + wrong), CENTER + 100.0 * wrong)
    assert max(off(result, camera)) < 1e-6
    np.testing.assert_allclose(result.estimate.focal, FOCAL, rtol=1e-6)
    np.testing.assert_allclose(result.estimate.center, CENTER, atol=1e-3)
    assert result.rms < 1e-3
    assert not result.dropped


def test_errors_are_as_large_as_the_standard_deviations_say():
    ratios = []
    for seed in range(6):
        views = make_views(CAMERA, count=10, noise=0.15, seed=seed)
        result = calibrate(views, FOCAL, CENTER)
        position, rotation = off(result, CAMERA)
        ratios.append([position / result.position_std, rotation / result.rotation_std])
        assert result.rms == pytest.approx(0.15 * np.sqrt(2.0), rel=0.15)
    # Of 6 trials with 3 axes each, the root mean square of a ratio lies within 0.6 and
    # 1.4 in 99 of 100 cases if the deviations are right.
    spread = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert np.all((spread > 0.6) & (spread < 1.4))


def test_a_few_wrong_corners_hardly_matter():
    views = make_views(CAMERA, count=12, noise=0.1)
    before, _ = off(calibrate(views, FOCAL, CENTER), CAMERA)
    for i in (0, 4, 8):
        views[i].pixels[3] += [6.0, -5.0]
    after, turn = off(calibrate(views, FOCAL, CENTER), CAMERA)
    assert after < before + 2e-4
    assert turn < np.radians(0.05)


ROW = np.stack([np.arange(6) * 0.03, np.zeros(6), np.zeros(6)], axis=1)


@pytest.mark.parametrize(
    ("p_B", "reason"),
    [(BOARD.corners[:5], "5 corners"), (ROW, "6 corners on one line")],
)
def test_a_view_with_too_few_corners_is_dropped_and_told(p_B, reason):
    views = make_views(CAMERA, count=8)
    views[2] = dc.replace(views[2], p_B=p_B, pixels=views[2].pixels[: len(p_B)])
    result = calibrate(views, FOCAL, CENTER)
    assert result.dropped == {"view_02": reason}
    assert len(result.views) == 7


@pytest.mark.parametrize(
    ("views", "message"),
    [
        (make_views(CAMERA, count=4), "4 usable views, needs at least 5"),
        (make_views(CAMERA, count=8, tilt=0.0), "8 views are too alike: condition"),
        ([make_views(CAMERA, count=1)[0]] * 8, "8 views are too alike: condition"),
        (make_views(CAMERA, count=8, noise=20.0), "no camera fits"),
    ],
)
def test_views_that_tell_too_little_are_refused(views, message):
    with pytest.raises(ScenarioError, match=message):
        calibrate(views, FOCAL, CENTER)


def test_wrong_poses_of_the_hand_are_refused():
    views = make_views(CAMERA, count=8)
    views[0] = dc.replace(views[0], X_PQ=views[1].X_PQ)
    views[5] = dc.replace(views[5], X_PQ=views[3].X_PQ)
    with pytest.raises(ScenarioError, match="no camera fits"):
        calibrate(views, FOCAL, CENTER)
