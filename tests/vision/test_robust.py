import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from drake_srg.vision.robust import robust_deviation


@pytest.mark.parametrize("outliers", [0, 300])
def test_it_is_the_standard_deviation_with_and_without_outliers(outliers):
    residuals = np.random.default_rng(0).normal(0.0, 2e-3, 10_000)
    residuals[:outliers] = 1.0
    assert robust_deviation(residuals) == pytest.approx(2e-3, rel=0.05)


finite_or_not = st.floats(allow_nan=False, width=32)


@given(
    st.sampled_from([np.float32, np.float64]).flatmap(
        lambda dtype: arrays(dtype, st.integers(1, 9), elements=finite_or_not)
    )
)
def test_it_uses_the_median_to_the_last_bit(residuals):
    with np.errstate(over="ignore"):
        median = np.median(np.abs(residuals))
        assert robust_deviation(residuals) == 1.4826 * float(median)


def test_without_residuals_it_is_nan():
    assert np.isnan(robust_deviation(np.zeros(0)))
