import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.learning.network import best_action

from .made_policies import made_network


@given(st.lists(st.integers(1, 5), min_size=2, max_size=4), st.integers(1, 3))
def test_a_network_has_the_sizes_it_was_made_with(sizes, members):
    network = made_network(sizes, members)
    assert network.sizes == tuple(sizes)
    assert network(np.zeros((7, sizes[0]), np.float32)).shape == (members, 7, sizes[-1])


def test_a_member_is_one_of_the_ensemble():
    network = made_network((3, 4, 1), members=3)
    x = np.ones((2, 3), np.float32)
    for k in range(3):
        np.testing.assert_allclose(network.member(k)(x)[0], network(x)[k], rtol=1e-5)


class Peak:
    """Values with a single peak."""

    def __init__(self, at, spread=0.0):
        self.at, self.spread = np.array(at), spread

    def __call__(self, x):
        a = x[:, -len(self.at) :]
        value = -np.sum((a - self.at) ** 2, axis=1)
        # The second member trusts no positive first entry.
        doubt = self.spread * np.maximum(a[:, 0], 0.0)
        return np.stack([value + doubt, value - doubt])[..., None]


def test_the_peak_is_found():
    x = np.zeros(2, np.float32)
    for at in ([0.3, -0.7], [0.9, 0.9], [0.0, 0.0]):
        np.testing.assert_allclose(best_action(Peak(at), x, 2), at, atol=0.08)


def test_where_members_differ_the_action_is_avoided():
    x = np.zeros(2, np.float32)
    bold = best_action(Peak([0.5, 0.0], 3.0), x, 2, caution=0.0)
    careful = best_action(Peak([0.5, 0.0], 3.0), x, 2, caution=1.0)
    assert careful[0] < 0.1 < bold[0]


def test_the_same_call_gives_the_same_action():
    x = np.zeros(2, np.float32)
    peak = Peak([0.2, 0.1])
    np.testing.assert_array_equal(best_action(peak, x, 2), best_action(peak, x, 2))
