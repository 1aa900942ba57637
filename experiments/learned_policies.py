"""Policies that learn in minutes: where they hold, and what uncertainty costs.

Each recipe of docs/training.md trains with several seeds. The policies then grasp
unseen objects, also on the accurate physics, and in the kitchen in place of our
planner. Two hand-written rules of `Pick` show the effect of an uncertain position. One
closes at the estimate. The other searches by touch: it sweeps a cylinder to a known
place, and tries a box again beside the estimate.

A standard deviation of 15 mm costs a fifth of the objects, 20 mm a third. Touch regains
most of them, and so do the policies that imitate the rule with touch.
"""

import dataclasses as dc
import itertools
import time
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import experiments.runner as ex
from drake_srg.learning.episodes import EVALUATION, Act, make_environment, run_episode
from drake_srg.learning.evaluate_in_cell import run_cell_trial
from drake_srg.learning.rules import TOUCH, pick, pick_by_touch
from drake_srg.learning.train import POLICY, Training, train
from drake_srg.scenario import load_tree

# A training, and how long it may take [min of processor time].
_PICK: dict[str, Any] = {"environment": "Pick", "algorithm": "dagger"}
_TOUCH: dict[str, Any] = {"keywords": {"noise": 0.02}, "rule": TOUCH}
RECIPES = {
    "one-shot": (Training(environment="GraspOneShot", steps=1000), 5.0),
    "pick": (Training(**_PICK, steps=20_000, validation=100), 10.0),
    "touch": (Training(**_PICK, **_TOUCH, steps=80_000, validation=100), 10.0),
}
_CELL, _DRIVER = "kitchen_fast", ["gripper=!PlantServoDriver {}"]
SEEN, TOUCHED = "where it was seen", "by touch"
RULES: dict[str, Act] = {SEEN: pick, TOUCHED: pick_by_touch}
NOISES = (0.005, 0.015, 0.02)  # m
# Unseen objects for each rule with each noise, and for each policy; of these on the
# accurate physics, and as many trials in the kitchen.
_EPISODES, _UNSEEN, _ELSEWHERE = 1000, 200, 20
# By how much rule and policies with touch must beat the rule without.
_BETTER = ex.at_least(0.15, spread=0.05)


def cases(seeds: int = 3) -> list[ex.Case]:
    """Train, and judge the policies; judge the rules.

    Args:
        seeds: Trainings of each recipe.
    """
    trained = ex.grid(name=RECIPES, seed=range(seeds), noise=[0.0])
    return trained + ex.grid(name=RULES, seed=[0], noise=NOISES)


def trial(name: str, seed: int, noise: float) -> ex.Measures:
    """Play a rule, or train once: successes by place, minutes of processor time."""
    if name in RULES:
        return {"unseen": held(RULES[name], "Pick", {"noise": noise}, _EPISODES)}
    training = dc.replace(RECIPES[name][0], seed=seed)
    environment, keywords = training.environment, training.keywords
    with TemporaryDirectory() as folder:
        start = time.process_time()
        policy = train(training, Path(folder))
        minutes = (time.process_time() - start) / 60.0
        tree = load_tree(_CELL, _DRIVER)
        file = str(Path(folder) / POLICY)
        cell = [
            run_cell_trial(file, policy.info.environment, tree, _CELL, EVALUATION, k)
            for k in range(_ELSEWHERE)
        ]
    accurate = {**keywords, "physics": "accurate"}
    return {
        "minutes": minutes,
        "unseen": held(policy, environment, keywords, _UNSEEN),
        "accurate": held(policy, environment, accurate, _ELSEWHERE),
        "kitchen": [bool(trial.row["success"]) for trial in cell],
    }


def held(
    act: Act, environment: str, keywords: Mapping[str, Any], trials: int
) -> list[bool]:
    """Return whether the object was held in each of the unseen episodes."""
    env = make_environment(environment, keywords)
    done = [run_episode(env, act, EVALUATION + k).success for k in range(trials)]
    env.close()
    return done


def whole(trials: ex.Trials) -> dict[str, ex.Values]:
    def played(rule: str, noise: float) -> float:
        return float(np.mean(trials.where(name=rule, noise=noise).one("unseen")))

    found: dict[str, ex.Values] = {}
    for recipe, (training, limit) in RECIPES.items():
        own = trials.where(name=recipe)
        unseen, *others = (
            float(np.median([np.mean(t[place]) for t in own]))
            for place in ("unseen", "accurate", "kitchen")
        )
        longest = (max(own["minutes"]), ex.at_most(limit, clock="time"))
        found[recipe] = {"longest training [min]": longest}
        if recipe == "touch":
            more = unseen - played(SEEN, training.keywords["noise"])
            found[recipe][f"held, median, more than {SEEN} []"] = (more, _BETTER)
        else:
            found[recipe]["held, median []"] = (unseen, ex.at_least(0.95))
        for place, share in zip(("accurate", "kitchen"), others, strict=True):
            # This share of what they hold of unseen objects.
            kept = (share / max(unseen, 1e-9), ex.at_least(0.95))
            found[recipe][f"held, {place}, of that []"] = kept
    for rule, noise in itertools.product(RULES, NOISES):
        done = trials.where(name=rule, noise=noise).one("unseen")
        shares = ex.share("held", sum(done), len(done), spread=0.05)
        found[f"{rule}, {1e3 * noise:.0f} mm"] = shares
    for noise in NOISES[1:]:
        better = played(TOUCHED, noise) - played(SEEN, noise)
        found[f"touch, {1e3 * noise:.0f} mm"] = {"holds more []": (better, _BETTER)}
    return found


learned_policies = ex.Experiment(
    "Policies that learn in minutes: where they hold, and what uncertainty costs.",
    cases,
    trial,
    summary=lambda own: {},
    whole=whole,
    picture=[ex.Bars(["held"]), ex.Bars(["held, median"])],
    serial=True,
)
