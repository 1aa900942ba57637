import numpy as np
import pytest
from robot.calibrate.helpers import make_views, pose, truth

from drake_srg.experiments.calibration_runs import (
    Rendered,
    corner_errors,
    judge,
    synthesize,
)

TRUTH = truth(pose([0.1, -3.0, 0.4], [0.2, 0.1, 1.2]), pose([3.1, 0, 0.2], [0.1, 0, 0]))


@pytest.fixture(scope="module")
def runs():
    views = [make_views(TRUTH, count=6, noise=0.1, seed=seed) for seed in range(2)]
    return [Rendered(None, TRUTH, many, None) for many in views]


def test_the_noise_of_rendered_corners_is_that_of_synthetic_ones(runs):
    assert corner_errors(runs).std() == pytest.approx(0.1, rel=0.1)
    trial = synthesize(runs, np.random.default_rng(0), 8)
    assert trial.rms == pytest.approx(0.1 * np.sqrt(2.0), rel=0.2)
    assert 0.0 < trial.position < 4.0 * trial.position_std
    assert 0.0 < trial.rotation < 4.0 * trial.rotation_std
    again = synthesize(runs, np.random.default_rng(0), 8)
    assert again == trial


def test_a_failed_calibration_has_no_errors(runs):
    assert runs[0].trial() is None
    assert synthesize(runs, np.random.default_rng(0), 4) is None


def test_errors_are_those_of_the_camera():
    moved = truth(TRUTH.X_PC @ pose([0, 0, 0.01], [0.003, 0, 0.004]), TRUTH.X_QB)

    class Result:
        estimate, position_std, rotation_std, rms = moved, 1.0, 2.0, 3.0

    trial = judge(Result, TRUTH)
    assert trial.position == pytest.approx(0.005)
    assert trial.rotation == pytest.approx(0.01)
    assert (trial.focal, trial.center) == (0.0, 0.0)
    assert (trial.position_std, trial.rotation_std, trial.rms) == (1.0, 2.0, 3.0)
