import pytest

from drake_srg.learning.baselines import rule_of
from drake_srg.learning.episodes import EVALUATION, make_environment, run_episode
from drake_srg.learning.policy import load_policy, shipped_policies

EPISODES = 8


@pytest.mark.parametrize("name", sorted(shipped_policies()))
def test_a_shipped_policy_takes_unseen_objects(name):
    policy = load_policy(name)
    env = make_environment(policy.info.environment, policy.info.keywords)
    assert rule_of(env) is not None  # what it is compared with
    held = [run_episode(env, policy, EVALUATION + k).success for k in range(EPISODES)]
    # Of a policy that holds 95 %, fewer succeed once in 2,700 times.
    assert sum(held) >= EPISODES - 3


@pytest.mark.parametrize("name", sorted(shipped_policies()))
def test_a_shipped_policy_says_how_it_was_made(name):
    info = load_policy(name).info
    assert info.command.startswith("drake-srg train ")
    assert info.steps > 0
    assert info.scores["validation"] >= 0.95
