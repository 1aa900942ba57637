import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.servoing.arm_history import ArmHistory

SPAN = 1.0


def moved(stamps, ahead=5.0, history=None):
    """The history of two joints that move evenly; our clock is ahead of the arm's."""
    history = history or ArmHistory()
    for stamp in stamps:
        q = np.array([stamp, -2.0 * stamp])
        history = history.followed_by(stamp, stamp + ahead, q, SPAN)
    return history


@given(st.floats(0.0, 0.9))
def test_an_even_motion_is_known_at_any_time_of_it(stamp):
    taken = moved([0.0, 0.1, 0.35, 0.9]).at(stamp)
    np.testing.assert_allclose(taken.q, [stamp, -2.0 * stamp], atol=1e-12)
    np.testing.assert_allclose(taken.time, stamp + 5.0)


def test_nothing_is_known_outside_of_the_history():
    history = moved([0.0, 0.5])
    assert history.at(-0.01) is None
    assert history.at(0.51) is None
    assert history.at(np.nan) is None
    assert ArmHistory().at(0.0) is None


def test_what_is_too_long_ago_is_forgotten():
    history = moved(np.linspace(0.0, 3.0, 31))
    assert history.at(1.9) is None
    assert history.at(2.05) is not None
    assert len(history.stamps) <= 12


def test_measurements_that_are_not_new_change_nothing():
    history = moved([0.0, 0.5])
    assert moved([0.5, np.nan], history=history) is history


def test_a_clock_that_is_set_back_begins_anew():
    history = moved([10.0, 10.5, 0.0, 0.5])
    assert history.at(10.2) is None
    np.testing.assert_allclose(history.at(0.25).q, [0.25, -0.5])
