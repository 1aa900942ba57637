import numpy as np

from drake_srg.common.cross import cross


def test_cross_agrees_with_numpy():
    a, b = np.random.default_rng(0).normal(size=(2, 5, 4, 3))
    np.testing.assert_allclose(cross(a[:, :1], b), np.cross(a[:, :1], b))
