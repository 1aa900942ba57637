"""Environments that the tests share; building one takes a tenth of a second."""

import gymnasium
import pytest

import drake_srg.learning.envs


@pytest.fixture(scope="package")
def envs():
    """The environments by name, as gymnasium makes them, without wrappers."""
    made = {}

    def get(name):
        if name not in made:
            made[name] = gymnasium.make(f"drake_srg/{name}").unwrapped
        return made[name]

    assert drake_srg.learning.envs.ENVIRONMENTS
    return get


@pytest.fixture
def pick(envs):
    return envs("Pick-v0")
