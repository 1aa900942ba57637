import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from drake_srg.gripper.underactuation import finger_targets
from gripper.underactuation_case import angle, make, targets

LAST = (0.7, 0.1)
two_bools = st.tuples(st.booleans(), st.booleans())


def curled(target, opening, angles, fired):
    return finger_targets(target, opening, angles, fired, LAST, curl=True)


@given(target=st.floats(0.0, 3.0), base=angle, tip=angle)
def test_a_tip_that_touches_takes_the_rest(target, base, tip):
    result = curled(target, False, (base, tip), (False, True))
    assert result == pytest.approx((LAST[0], target - base))


@given(
    target=st.floats(0.0, 3.0),
    opening=st.booleans(),
    angles=st.tuples(angle, angle),
    fired=two_bools,
)
def test_all_else_is_algorithm_1(target, opening, angles, fired):
    assume(opening or fired != (False, True))
    plain = finger_targets(target, opening, angles, fired, LAST)
    assert curled(target, opening, angles, fired) == plain


@pytest.mark.parametrize("tip", ["algorithm_1", "curl"])
@pytest.mark.parametrize("fired", [[0, 0, 0, 1], [0, 0, 1, 0]])
def test_one_tip_alone_stays_straight(tip, fired):
    """A tip that had touched something in passing stayed bent for the next grasp."""
    # Full scale 3: a closure of 0.5 asks for 1.5 rad.
    system, context = make(0.5, [0.7] * 2 + [0.0] * 2, fired, tip=tip)
    assert targets(system, context) == pytest.approx([1.5, 1.5, 0.0, 0.0])


def test_a_finger_whose_base_senses_too_does_not_curl():
    system, context = make(0.5, [0.7] * 2 + [0.0] * 2, [1, 0, 1, 1], tip="curl")
    both_links = 0.7 + 0.5 * (1.5 - 0.7)  # Algorithm 1 shares what is left
    assert targets(system, context) == pytest.approx([both_links, 0.0, 0.4, 0.8])


@given(lean=st.floats(-0.3, 1.5), apart=st.floats(0.0, 0.6), least=st.floats(0.0, 0.3))
def test_both_tips_curl_or_none_by_how_far_the_bases_lean_on_average(
    lean, apart, least
):
    assume(abs(lean - least) > 1e-6)
    middle = 0.5 * np.pi - lean
    bases = np.clip([middle - apart, middle + apart], -0.1, 1.94)
    assume(np.mean(bases) == pytest.approx(middle))
    system, context = make(
        1.0, [*bases, 0.0, 0.0], [0, 0, 1, 1], tip="curl", curl_lean=least
    )
    curls = targets(system, context)[2:] > 0.0
    assert curls.tolist() == [lean > least] * 2
