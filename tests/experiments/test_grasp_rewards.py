import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from drake_srg.experiments import grasp_rewards
from drake_srg.experiments.grasp_rewards import REWARDS, Learned, Trial, judged
from drake_srg.experiments.registry import find_experiment

NEVER = [False] * 120


def learned(until, unseen=10, hard=5):
    """A training that fails until an episode and then succeeds, and its policy."""
    training = [k >= until for k in range(120)]
    return Learned(
        training, [k < unseen for k in range(10)], [k < hard for k in range(10)]
    )


def rows_of(made):
    result = judged(made, 120)
    return result, {(row.name, row.quantity): row for row in result.rows}


def test_it_is_learned_when_nine_of_ten_episodes_in_a_row_succeed():
    assert learned(0).episodes == 40
    assert learned(50).episodes == 50 + 36
    assert Learned(NEVER, [], []).episodes is None


def test_a_reward_without_a_shake_may_be_as_good():
    _, rows = rows_of({"success": [learned(50)] * 2, "slip_margin": [learned(20)] * 2})
    assert rows["slip_margin", "episodes until 90 % succeed, median"].measured == 56
    assert rows["slip_margin", "trainings that reach 90 %"].measured == 2
    assert rows["slip_margin", "held, hard"].measured == 0.5
    low, high = (
        rows["success", f"held, hard, at {x}"].measured for x in ("least", "most")
    )
    assert low == pytest.approx(0.299, abs=1e-3)
    assert high == pytest.approx(0.701, abs=1e-3)
    assert all(row.passed for row in rows.values())


def test_rewards_that_teach_nothing_fail():
    made = {"success": [learned(50, unseen=8)], "lifted": [learned(110, unseen=3)]}
    _, rows = rows_of(made)
    assert not rows["the shake as reward", "held, unseen"].passed
    behind = rows["best reward without a shake", "held, unseen, more than with a shake"]
    assert behind.measured == pytest.approx(-0.5)
    assert not behind.passed
    assert rows["lifted", "episodes until 90 % succeed, median"].measured == 120


def test_the_table_has_a_line_for_each_training():
    made = {name: [learned(50), learned(60)] for name in REWARDS}
    result, _ = rows_of(made)
    table = result.tables["trainings"]
    assert len(table["reward"]) == 2 * len(REWARDS)
    assert np.all(np.array(table["episodes until 90 %"]) > 80)


def test_results_do_not_depend_on_the_number_of_threads(monkeypatch):
    threads = []

    def look(*_):
        infos = threadpool_info()
        threads.extend(i["num_threads"] for i in infos if i["user_api"] == "blas")
        raise StopIteration

    monkeypatch.setattr(grasp_rewards, "make_environment", look)
    with threadpool_limits(2, "blas"), pytest.raises(StopIteration):
        grasp_rewards._train(Trial("success", 0), 1, 1)
    assert set(threads) == {1}


def test_it_is_an_experiment():
    parameters = find_experiment("grasp_rewards").parameters
    assert {"episodes", "seeds", "trials", "keep"} <= parameters.keys()
