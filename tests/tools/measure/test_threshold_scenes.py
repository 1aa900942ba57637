import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform

from drake_srg.types import Cylinder
from measure.threshold_scenes import lean
from tools.measure.made_looks import DOUBTED, GOOD, MISSED, OFF, TURNED, UNSEEN


@pytest.mark.parametrize(
    ("look", "loss"),
    [(GOOD, 0), (DOUBTED, 1), (UNSEEN, 1), (OFF, 2), (TURNED, 2), (MISSED, 3)],
)
def test_false_certainty_counts_twice(look, loss):
    assert look.loss == loss


@given(st.integers(0, 1000))
def test_a_leaning_cylinder_touches_the_table_or_hangs(seed):
    cylinder = Cylinder(0.012, 0.05)
    X_WO = lean(RigidTransform([0.1, 0.2, 0.025]), cylinder, seed)
    axis, p = X_WO.rotation().matrix()[:, 2], X_WO.translation()
    assert p[:2] == pytest.approx([0.1, 0.2])
    assert axis[2] >= 0.0
    lowest = p[2] - 0.025 * axis[2] - 0.012 * np.hypot(axis[0], axis[1])
    if seed % 2:
        assert 0.0 <= lowest <= 0.1
    else:
        assert lowest == pytest.approx(0.0, abs=1e-12)
