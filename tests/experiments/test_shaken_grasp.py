import numpy as np
import pytest

from drake_srg.experiments.household import household_cases
from drake_srg.experiments.shaken_grasp import _drawn, shaken_grasp

CASES = {str(case): case for case in household_cases()}


def test_draws_depend_on_the_seed_alone():
    case = CASES["004_sugar_box, side"]
    first, second, other = (_drawn(case, np.random.default_rng(s)) for s in (1, 1, 2))
    assert first == second
    assert first != other


@pytest.mark.slow
def test_a_wrapped_can_is_lifted_and_its_contacts_are_read():
    made = shaken_grasp(CASES["005_tomato_soup_can, side"], 2)
    assert made.lifted
    assert len(made.patches) >= 2
    assert made.body.mass > 0.1
    assert made.body.p_WB[2] > 0.05
    # The contacts carry the weight.
    carried = sum(patch.f_W for patch in made.patches)
    np.testing.assert_allclose(carried, [0, 0, 9.81 * made.body.mass], atol=0.5)
