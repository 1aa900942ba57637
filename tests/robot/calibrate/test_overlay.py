import json

import numpy as np
import pytest

from drake_srg.robot.calibrate.mounting import Board, mount
from drake_srg.robot.calibrate.overlay import X_PB, answer, overlay, report
from drake_srg.robot.calibrate.solve import Unknowns, calibrate
from drake_srg.scenario import load_scenario
from drake_srg.station.planners import own_scene
from robot.calibrate.helpers import make_views


@pytest.fixture(scope="module")
def calibrated():
    scenario = load_scenario("kitchen_hand_camera")
    mounting = mount(scenario, "hand", own_scene(scenario), Board())
    camera = Unknowns(mounting.focal, mounting.center, mounting.X_PB, mounting.X_QO)
    views = make_views(camera, count=8, noise=0.1)
    return calibrate(views, mounting.focal, mounting.center), mounting


def test_a_scenario_takes_the_overlay(calibrated, tmp_path):
    result, mounting = calibrated
    path = tmp_path / "calibration.yaml"
    found = answer(result, mounting, simulated=False)
    path.write_text(overlay(found, "kitchen_hand_camera"))
    config = load_scenario(path).camera_calibrations["hand"]
    assert config.X_PB.base_frame == "gripper::palm"
    pose = config.X_PB.GetDeterministicValue()
    assert pose.IsNearlyEqualTo(X_PB(result, mounting), 1e-5)
    np.testing.assert_allclose(config.focal, result.estimate.focal, atol=1e-3)
    # The upper left corner of the image is half a pixel from its first pixel's middle.
    np.testing.assert_allclose(config.center, result.estimate.center + 0.5, atol=1e-3)


def test_the_report_says_how_certain_and_how_wrong_it_is(calibrated):
    result, mounting = calibrated
    found = json.loads(json.dumps(answer(result, mounting, simulated=True)))
    errors = found["errors"]
    assert 0.0 < errors["position_m"] < 4.0 * found["position_std_m"]
    assert 0.0 < errors["rotation_deg"] < 4.0 * found["rotation_std_deg"]
    lines = list(report(result, mounting, found))
    assert lines[0].startswith("camera hand, in the hand: 160 corners in 8 images")
    assert lines[2].endswith("true error")
    assert lines[6].endswith(f" {errors['rotation_deg']:.4f}")
    found = answer(result, mounting, simulated=False)
    assert found["errors"] is None
    assert not any("true error" in line for line in report(result, mounting, found))
