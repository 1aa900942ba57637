import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.learning.network import Adam, Network


def made(sizes, members=2, seed=0):
    return Network.random(sizes, np.random.default_rng(seed), members)


@given(st.lists(st.integers(1, 5), min_size=2, max_size=4), st.integers(1, 3))
def test_a_network_has_the_sizes_it_was_made_with(sizes, members):
    network = made(sizes, members)
    assert network.sizes == tuple(sizes)
    assert network(np.zeros((7, sizes[0]), np.float32)).shape == (members, 7, sizes[-1])


def test_gradients_are_those_of_differences():
    network = made((3, 4, 2))
    wide = Network(
        [w.astype(float) for w in network.weights],
        [b.astype(float) for b in network.biases],
    )
    x = np.random.default_rng(1).normal(size=(2, 5, 3))

    def loss():
        return 0.5 * np.sum(wide(x) ** 2)

    layers = wide.layers(x)
    gradients = wide.gradients(layers, layers[-1])
    for parameter, gradient in zip(wide.parameters, gradients, strict=True):
        for index in np.ndindex(parameter.shape):
            kept = parameter[index]
            parameter[index] = kept + 1e-6
            more = loss()
            parameter[index] = kept - 1e-6
            less = loss()
            parameter[index] = kept
            assert gradient[index] == pytest.approx((more - less) / 2e-6, abs=1e-5)


def test_a_member_is_one_of_the_ensemble():
    network = made((3, 4, 1), members=3)
    x = np.ones((2, 3), np.float32)
    for k in range(3):
        np.testing.assert_allclose(network.member(k)(x)[0], network(x)[k], rtol=1e-5)


def test_a_copy_is_independent():
    network = made((2, 2))
    copy = network.copy()
    copy.weights[0][:] = 0.0
    assert network.weights[0].any()


def test_adam_finds_the_minimum():
    x = np.array([3.0, -2.0], np.float32)
    adam = Adam([x], rate=0.1)
    for _ in range(300):
        adam.step([2.0 * (x - 1.0)])
    np.testing.assert_allclose(x, 1.0, atol=1e-2)


def test_decay_pulls_weights_to_zero():
    x = np.array([1.0], np.float32)
    Adam([x], rate=0.1, decay=0.5).step([np.zeros(1, np.float32)])
    assert x[0] == pytest.approx(0.95)
