import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.common.contact_damping import relaxation_time

DEPTH = 2e-4  # m


@given(st.floats(0.0, 100.0), st.floats(-1.0, 1.0))
def test_both_models_press_alike_at_the_same_depth(dissipation, rate):
    hunt_crossley = DEPTH * (1.0 + dissipation * rate)
    kelvin_voigt = DEPTH + relaxation_time(dissipation) * rate
    assert kelvin_voigt == pytest.approx(hunt_crossley, abs=1e-15)
