import dataclasses as dc

import pytest
from sweeps.stub import StubEngine

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.episodes import EVALUATION, VALIDATION
from drake_srg.learning.evaluate import evaluate, run_trial

from .made_policies import made_policy

HIT = "tests.learning.toy:toy/Hit-v0"


def run(policy, out, **changes):
    arguments = {"environment": HIT, "trials": 8, "engine": StubEngine(), **changes}
    return evaluate(str(policy), out=out, **arguments)


def test_the_rule_succeeds_and_random_actions_seldom_do(tmp_path):
    rule, chance = (
        sum(run(name, tmp_path / name)["success"].to_pylist())
        for name in ("rule", "random")
    )
    assert (rule, chance < 4) == (8, True)


@pytest.mark.parametrize(
    ("seed", "message"),
    [(VALIDATION, "training uses lower seeds"), (2**63 - 3, "--seed .*at most")],
)
def test_seeds_are_none_of_trainings_and_fit_into_a_row(tmp_path, seed, message):
    with pytest.raises(ScenarioError, match=message):
        run("rule", tmp_path / "out", seed=seed)
    assert not (tmp_path / "out").exists()


def test_a_policy_runs_with_the_keywords_of_its_training(tmp_path):
    made_policy(environment=HIT).save(tmp_path / "policy.npz")
    rows = run(tmp_path / "policy.npz", tmp_path / "out")
    assert rows.num_rows == 8
    text = (tmp_path / "out" / "sweep.json").read_text()
    assert 'driver=\\"plant\\"' in text


@pytest.mark.parametrize(
    ("policy", "message"),
    [
        (made_policy(environment="toy/Hits-v0"), "is a policy for toy/Hits-v0"),
        (made_policy(environment=HIT, n=3), "has 3 observations"),
        (made_policy(environment=HIT, m=1), "has 1 actions"),
    ],
)
def test_a_policy_of_another_environment_is_refused(tmp_path, policy, message):
    policy.save(tmp_path / "policy.npz")
    with pytest.raises(ScenarioError, match=message):
        run(tmp_path / "policy.npz", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_error_in_an_episode_is_an_outcome():
    result = run_trial("rule", HIT, '{"size": -1}', EVALUATION, 0)
    assert not result.row["success"]
    assert result.row["message"]


def test_interrupted_episodes_run_later(tmp_path):
    run("rule", tmp_path, trials=3)
    with pytest.raises(ScenarioError, match="--resume"):
        run("rule", tmp_path)
    rows = run("rule", tmp_path, resume=True)
    assert rows["seed"].to_pylist() == [EVALUATION + k for k in range(8)]


def test_another_policy_under_the_same_name_is_another_evaluation(tmp_path):
    path = tmp_path / "policy.npz"
    policy = made_policy(environment=HIT)
    policy.save(path)
    run(path, tmp_path / "out", trials=3)
    shifted = dc.replace(policy, low=policy.low - 1.0)
    shifted.save(path)
    with pytest.raises(ScenarioError, match="another sweep: policy_sha256"):
        run(path, tmp_path / "out", resume=True)
