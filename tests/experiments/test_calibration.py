import numpy as np
import pytest
from robot.calibrate.helpers import make_views

from drake_srg.experiments.calibration import BUILT, CALIBRATED, KNOCKED, make_result
from drake_srg.experiments.calibration_runs import Rendered, Trial
from experiments.test_calibration_runs import TRUTH

GOOD = Trial(1e-4, 1e-4, 1e-4, 0.1, 1e-4, 1e-4, 0.1)
FAR = Trial(4e-4, 1e-4, 1e-4, 0.1, 1e-4, 1e-4, 0.1)
TURNED = Trial(1e-4, 2e-3, 1e-4, 0.1, 1e-4, 1e-4, 0.1)
LOCATED = {BUILT: [1e-4], KNOCKED: [3e-2], CALIBRATED: [4e-4]}


class Known(Rendered):
    """A rendered calibration whose errors are known."""

    def trial(self):
        return self.result


def judged(rendered, synthetic, **located):
    runs = [
        Known(None, TRUTH, make_views(TRUTH, count=1, noise=0.1), trial)
        for trial in rendered
    ]
    errors = {case: np.array(off) for case, off in (LOCATED | located).items()}
    return make_result({"eye": runs}, {"eye": synthetic}, {"eye": errors})


def test_good_calibrations_pass():
    result = judged([GOOD] * 3, [GOOD] * 20)
    assert result.passed
    assert len(result.tables["calibrations"]["position"]) == 23
    found = {(row.name, row.quantity): row.measured for row in result.rows}
    assert found["eye, synthetic", "share within both limits"] == 1.0
    assert found["eye, synthetic", "share within both limits, at least"] < 0.9


@pytest.mark.parametrize("bad", [FAR, TURNED, None])
def test_one_bad_rendered_calibration_fails(bad):
    assert not judged([GOOD, bad], [GOOD] * 20).passed


@pytest.mark.parametrize("bad", [FAR, TURNED])
def test_one_synthetic_one_in_twenty_may_be_worse(bad):
    assert judged([GOOD], [*[GOOD] * 99, bad]).passed
    assert not judged([GOOD], [*[GOOD] * 8, bad, bad]).passed


def test_what_is_located_with_a_calibration_must_be_as_good_as_before():
    assert not judged([GOOD], [GOOD], **{CALIBRATED: [7e-4]}).passed
    assert judged([GOOD], [GOOD], **{KNOCKED: [1.0]}).passed
