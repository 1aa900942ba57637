import numpy as np
import pytest

from drake_srg.vision.robust import robust_deviation


@pytest.mark.parametrize("outliers", [0, 300])
def test_it_is_the_standard_deviation_with_and_without_outliers(outliers):
    residuals = np.random.default_rng(0).normal(0.0, 2e-3, 10_000)
    residuals[:outliers] = 1.0
    assert robust_deviation(residuals) == pytest.approx(2e-3, rel=0.05)
