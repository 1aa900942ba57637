import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from drake_srg.common.minimum_jerk import minimum_jerk_blend

unit = st.floats(0.0, 1.0)


@pytest.mark.parametrize("s", [-np.inf, -1.0, 0.0])
def test_the_motion_rests_before_its_start(s):
    assert minimum_jerk_blend(s) == 0.0


@pytest.mark.parametrize("s", [1.0, 2.0, np.inf])
def test_the_motion_rests_after_its_end(s):
    assert minimum_jerk_blend(s) == 1.0


@given(unit, unit)
def test_the_motion_never_turns_back(s, t):
    first, second = map(minimum_jerk_blend, sorted([s, t]))
    assert first <= second + 1e-15


@given(unit)
def test_the_second_half_mirrors_the_first(s):
    assert minimum_jerk_blend(s) + minimum_jerk_blend(1.0 - s) == pytest.approx(1.0)


@given(st.floats(-5.0, 5.0).filter(lambda c: abs(c) > 1e-3), st.floats(-1.0, 2.0))
def test_every_other_motion_from_rest_to_rest_has_more_jerk(size, root):
    s = np.linspace(0.0, 1.0, 6)
    blend = Polynomial.fit(s, [minimum_jerk_blend(x) for x in s], 5).convert()
    # Zero at both ends, like its first two derivatives.
    change = size * Polynomial([0, 1]) ** 3 * Polynomial([1, -1]) ** 3
    change *= Polynomial([-root, 1])

    def cost(motion):
        integral = (motion.deriv(3) ** 2).integ()
        return integral(1.0) - integral(0.0)

    assert cost(blend) == pytest.approx(720.0)
    assert cost(blend + change) > cost(blend)
