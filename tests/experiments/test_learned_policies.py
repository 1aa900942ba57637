import dataclasses as dc

import numpy as np
import pytest

from drake_srg.experiments import learned_policies
from drake_srg.experiments.learned_policies import NOISES, RECIPES, RULES, judged
from drake_srg.learning.train import Training


def trained(unseen=10, accurate=10, kitchen=10, minutes=1.0):
    """A training whose policy holds so many of ten objects in each place."""
    places = {"unseen": unseen, "accurate": accurate, "kitchen": kitchen}
    shares = {name: [k < n for k in range(10)] for name, n in places.items()}
    return {"minutes": minutes, **shares}


def played(seen=0.8, touched=0.96):
    shares = dict(zip(RULES, (seen, touched), strict=True))
    return {
        (rule, noise): [k < 100 * share for k in range(100)]
        for rule, share in shares.items()
        for noise in NOISES
    }


def rows_of(learned, rules):
    result = judged(learned, rules)
    return result, {(row.name, row.quantity): row for row in result.rows}


def test_the_median_of_the_seeds_counts():
    three = [trained(unseen=7), trained(), trained()]
    result, rows = rows_of(dict.fromkeys(RECIPES, three), played())
    assert rows["pick", "held, median"].passed
    assert rows["pick", "held, kitchen, of that"].measured == 1.0
    table = result.tables["trainings"]
    assert table["seed"] == [0, 1, 2] * len(RECIPES)
    np.testing.assert_allclose(table["unseen"], [0.7, 1.0, 1.0] * len(RECIPES))


def test_a_policy_that_fails_elsewhere_and_a_slow_training_fail():
    one = [trained(kitchen=9, minutes=6.0)]
    _, rows = rows_of(dict.fromkeys(RECIPES, one), played())
    assert not rows["one-shot", "held, kitchen, of that"].passed
    assert rows["one-shot", "held, accurate, of that"].passed
    assert not rows["one-shot", "longest training"].passed
    assert rows["pick", "longest training"].passed


@pytest.mark.parametrize(
    ("touched", "passed"), [(0.9, False), (0.96, True), (0.3, False)]
)
def test_touch_must_hold_more(touched, passed):
    learned = {recipe: [trained()] for recipe in RECIPES}
    _, rows = rows_of(learned, played(touched=touched))
    for mm in (15, 20):
        row = rows[f"touch, {mm} mm", "holds more"]
        assert row.passed == passed
        assert row.measured == pytest.approx(touched - 0.8)


@pytest.mark.parametrize(("unseen", "passed"), [(9, False), (10, True)])
def test_policies_with_touch_must_hold_more_than_the_rule_without(unseen, passed):
    learned = {recipe: [trained(unseen=unseen)] for recipe in RECIPES}
    _, rows = rows_of(learned, played(seen=0.8))
    row = rows["touch", "held, median, more than where it was seen"]
    assert row.passed == passed
    assert row.measured == pytest.approx(0.1 * unseen - 0.8)


def test_a_policy_that_holds_nothing_fails():
    learned = {recipe: [trained(0, 0, 0)] for recipe in RECIPES}
    _, rows = rows_of(learned, played())
    assert not rows["pick", "held, accurate, of that"].passed


@pytest.mark.learn
def test_a_recipe_is_trained_and_judged(monkeypatch):
    small = Training(environment="GraspOneShot", steps=20, validation=2)
    recipe = dc.replace(RECIPES["one-shot"], training=small)
    monkeypatch.setattr(learned_policies, "RECIPES", {"one-shot": recipe})
    found = learned_policies._learn("one-shot", 0, 2, 1)
    assert {name: len(found[name]) for name in ("unseen", "accurate", "kitchen")} == {
        "unseen": 2,
        "accurate": 1,
        "kitchen": 1,
    }
    assert 0.0 < found["minutes"] < 1.0
    assert len(learned_policies._play("by touch", 0.015, 2)["held"]) == 2
