import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.episodes import (
    EVALUATION,
    PER_RUN,
    RUNS,
    VALIDATION,
    environment_id,
    make_environment,
    run_episode,
    training_seed,
)

from .toy import Toy

HIT = "tests.learning.toy:toy/Hit-v0"


@given(st.integers(0, RUNS - 1), st.integers(0, PER_RUN - 1))
def test_no_seed_of_training_is_one_of_validation_or_evaluation(run, episode):
    assert 0 <= training_seed(run, episode) < VALIDATION < EVALUATION


@given(st.integers(0, RUNS - 1), st.integers(0, PER_RUN - 1))
def test_runs_have_seeds_of_their_own(run, episode):
    assert divmod(training_seed(run, episode), PER_RUN) == (run, episode)


@pytest.mark.parametrize(("run", "episode"), [(-1, 0), (RUNS, 0), (0, PER_RUN)])
def test_seeds_out_of_range_are_refused(run, episode):
    with pytest.raises(ScenarioError):
        training_seed(run, episode)


@pytest.mark.parametrize(
    ("name", "full"),
    [
        ("Pick", "drake_srg/Pick-v0"),
        ("drake_srg/Pick-v0", "drake_srg/Pick-v0"),
        ("drake_srg.learning.envs:drake_srg/Pick-v0", "drake_srg/Pick-v0"),
        ("toy/Hit", "toy/Hit-v0"),
        ("a.b:Toy-v1", "a.b:Toy-v1"),
    ],
)
def test_names_have_short_forms(name, full):
    assert environment_id(name) == full


def test_an_episode_is_the_same_for_the_same_seed():
    env = Toy(steps=3)
    first, second = (run_episode(env, env.rule, 5) for _ in range(2))
    np.testing.assert_array_equal(first.observations, second.observations)
    assert first.success
    assert first.actions.shape == (3, 2)
    assert first.observations.shape == (4, 2)


def test_an_environment_of_somebody_else_is_made():
    assert isinstance(make_environment(HIT).unwrapped, Toy)


@pytest.mark.parametrize(
    ("name", "keywords", "message"),
    [
        ("Nothing", {}, "unknown environment 'drake_srg/Nothing-v0'"),
        ("nowhere:Toy", {}, "No module named 'nowhere'"),
        (HIT, {"what": 1}, "unexpected keyword argument 'what'"),
        ("drake_srg/GraspOneShot-v0", {"drive": "x"}, "unknown keyword 'drive'"),
    ],
)
def test_a_wrong_name_or_keyword_is_one_line(name, keywords, message):
    with pytest.raises(ScenarioError, match=message) as error:
        make_environment(name, keywords)
    assert "\n" not in str(error.value)


class _Words(Toy):
    def __init__(self):
        super().__init__()
        self.action_space = gymnasium.spaces.Discrete(3)


def test_spaces_that_learners_do_not_take_are_refused():
    gymnasium.register("toy/Words-v0", _Words, disable_env_checker=True)
    with pytest.raises(ScenarioError, match="action: learners need a flat vector"):
        make_environment("toy/Words")


@pytest.mark.parametrize(
    ("kind", "bound"), [("observation", np.inf), ("action", np.inf), ("action", 2.0)]
)
def test_bounds_that_policies_do_not_know_are_refused(kind, bound):
    class Wide(Toy):
        def __init__(self):
            super().__init__()
            space = gymnasium.spaces.Box(-bound, bound, (2,), np.float32)
            setattr(self, f"{kind}_space", space)

    name = f"toy/Wide{kind}{bound:.0f}-v0"
    gymnasium.register(name, Wide, disable_env_checker=True)
    with pytest.raises(ScenarioError, match=f"{kind}: learners need finite bounds"):
        make_environment(name)
