"""Policies that learn in minutes: where they hold, and what uncertainty costs.

Each recipe of docs/training.md trains with several seeds. The policies then grasp
unseen objects, also on the accurate physics and, in place of our planner, in the
kitchen. Hand-written rules of `Pick` show what an object is worth whose place is not
known well: one closes where the object was seen, and one finds it by touch.
"""

from __future__ import annotations

import dataclasses as dc
import functools
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from drake_srg.experiments.kept_trials import KeptTrials
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.learning.episodes import EVALUATION, Act, make_environment, run_episode
from drake_srg.learning.evaluate_in_cell import run_cell_trial
from drake_srg.learning.rules import TOUCH, pick, pick_by_touch
from drake_srg.learning.train import POLICY, Training, train
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.scenario import load_tree
from drake_srg.sweeps.statistics import wilson_interval


@dc.dataclass(frozen=True)
class Recipe:
    """A training, and what is asked of it.

    Attributes:
        training: The training.
        minutes: How long it may take [min of processor time].
        least: What its policies must hold of unseen objects (median of the seeds).
            None: `_BETTER` more than the rule that closes where they were seen.
    """

    training: Training
    minutes: float
    least: float | None = 0.95


RECIPES = {
    "one-shot": Recipe(Training(environment="GraspOneShot", steps=1000), 5.0),
    "pick": Recipe(
        Training(environment="Pick", algorithm="dagger", steps=20_000, validation=100),
        10.0,
    ),
    "touch": Recipe(
        Training(
            environment="Pick",
            keywords={"noise": 0.02},
            algorithm="dagger",
            rule=TOUCH,
            steps=80_000,
            validation=100,
        ),
        10.0,
        least=None,
    ),
}
# What share of the unseen objects that they hold policies must hold elsewhere.
_KEPT = 0.95
_CELL, _DRIVER = "kitchen_fast", ["gripper=!PlantServoDriver {}"]
RULES: dict[str, Act] = {"where it was seen": pick, "by touch": pick_by_touch}
NOISES = (0.005, 0.015, 0.02)  # m
_BETTER = 0.15  # by which rule and policies with touch must beat the rule without


def run(
    track: Track,
    *,
    seeds: int = 3,
    trials: int = 200,
    elsewhere: int = 20,
    episodes: int = 1000,
    keep: str = "",
) -> ExperimentResult:
    """Train, and judge the policies; judge the rules.

    Args:
        track: Shows progress.
        seeds: Trainings of each recipe.
        trials: Unseen objects for each policy.
        elsewhere: Of them on the accurate physics, and as many trials in the kitchen.
        episodes: Of each rule with each uncertainty.
        keep: File of finished trials, with which a run that was cut off goes on.
    """
    kept = KeptTrials(keep)
    work: dict[str, Callable[[], Mapping[str, Any]]] = {}
    for recipe, made_by in RECIPES.items():
        for seed in range(seeds):
            name = f"{recipe}, {made_by.training.steps} steps, seed {seed}, "
            name += f"{trials} and {elsewhere} trials"
            work[name] = functools.partial(_learn, recipe, seed, trials, elsewhere)
    for rule in RULES:
        for noise in NOISES:
            name = f"{rule}, {noise} m, {episodes} episodes"
            work[name] = functools.partial(_play, rule, noise, episodes)
    made = {name: kept(name, work[name]) for name in track(list(work))}
    learned = {
        recipe: [found for name, found in made.items() if name.startswith(recipe)]
        for recipe in RECIPES
    }
    played = {
        (rule, noise): made[f"{rule}, {noise} m, {episodes} episodes"]["held"]
        for rule in RULES
        for noise in NOISES
    }
    return judged(learned, played)


def _learn(recipe: str, seed: int, trials: int, elsewhere: int) -> Mapping[str, Any]:
    """Train once, and return successes by place, and minutes of processor time."""
    training = dc.replace(RECIPES[recipe].training, seed=seed)
    environment, keywords = training.environment, training.keywords
    with TemporaryDirectory() as folder:
        start = time.process_time()
        policy = train(training, Path(folder))
        minutes = (time.process_time() - start) / 60.0
        tree = load_tree(_CELL, _DRIVER)
        file = str(Path(folder) / POLICY)
        cell = [
            run_cell_trial(file, policy.info.environment, tree, _CELL, EVALUATION, k)
            for k in range(elsewhere)
        ]
    return {
        "minutes": minutes,
        "unseen": _held(policy, environment, keywords, trials),
        "accurate": _held(
            policy, environment, {**keywords, "physics": "accurate"}, elsewhere
        ),
        "kitchen": [bool(trial.row["success"]) for trial in cell],
    }


def _play(rule: str, noise: float, episodes: int) -> Mapping[str, Any]:
    """Return the successes of a rule."""
    return {"held": _held(RULES[rule], "Pick", {"noise": noise}, episodes)}


def _held(
    act: Act, environment: str, keywords: Mapping[str, Any], trials: int
) -> list[bool]:
    """Return in which episodes that took no part in training an object was held."""
    env = make_environment(environment, keywords)
    held = [run_episode(env, act, EVALUATION + k).success for k in range(trials)]
    env.close()
    return held


def judged(
    learned: Mapping[str, Sequence[Mapping[str, Any]]],
    played: Mapping[tuple[str, float], Sequence[bool]],
) -> ExperimentResult:
    """Judge trainings and rules.

    Args:
        learned: What became of the trainings of each recipe.
        played: Successes of each rule with each uncertainty [m].
    """
    rows: list[Row] = []
    for recipe, found in learned.items():
        minutes = max(one["minutes"] for one in found)
        limit = RECIPES[recipe].minutes
        rows.append(
            Row.at_most(recipe, "longest training", limit, minutes, "min", clock="time")
        )
        shares = {
            place: float(np.median([np.mean(one[place]) for one in found]))
            for place in ("unseen", "accurate", "kitchen")
        }
        unseen = shares.pop("unseen")
        rows.append(_unseen_row(recipe, unseen, played))
        rows += [
            Row.at_least(
                recipe, f"held, {place}, of that", _KEPT, share / max(unseen, 1e-9), ""
            )
            for place, share in shares.items()
        ]
    bounds = {
        key: wilson_interval(sum(held), len(held)) for key, held in played.items()
    }
    for (rule, noise), held in played.items():
        low, high = bounds[rule, noise]
        name = f"{rule}, {1e3 * noise:.0f} mm"
        rows += [
            Row.info(name, "held", float(np.mean(held)), "", spread=0.05),
            Row.info(name, "held, at least", low, "", spread=0.05),
            Row.info(name, "held, at most", high, "", spread=0.05),
        ]
    seen, touched = RULES
    for noise in NOISES[1:]:
        better = float(np.mean(played[touched, noise]) - np.mean(played[seen, noise]))
        name, quantity = f"touch, {1e3 * noise:.0f} mm", "holds more"
        rows.append(Row.at_least(name, quantity, _BETTER, better, "", spread=0.05))
    table: dict[str, Any] = {
        "recipe": [recipe for recipe, found in learned.items() for _ in found],
        "seed": [k for found in learned.values() for k in range(len(found))],
        **{
            what: [np.mean(one[what]) for found in learned.values() for one in found]
            for what in ("unseen", "accurate", "kitchen")
        },
        "minutes": [one["minutes"] for found in learned.values() for one in found],
    }
    return ExperimentResult(rows, {"trainings": table}, _draw(table, played, bounds))


def _unseen_row(
    recipe: str, unseen: float, played: Mapping[tuple[str, float], Sequence[bool]]
) -> Row:
    """Judge which share of the unseen objects the policies of a recipe hold."""
    least, training = RECIPES[recipe].least, RECIPES[recipe].training
    if least is not None:
        return Row.at_least(recipe, "held, median", least, unseen, "")
    seen = next(iter(RULES))
    better = unseen - float(np.mean(played[seen, training.keywords["noise"]]))
    quantity = f"held, median, more than {seen}"
    return Row.at_least(recipe, quantity, _BETTER, better, "", spread=0.05)


def _draw(
    table: Mapping[str, Any],
    played: Mapping[tuple[str, float], Sequence[bool]],
    bounds: Mapping[tuple[str, float], tuple[float, float]],
) -> Any:
    """Draw the shares that policies and rules hold."""
    figure = make_figure(9.0, 3.6, "What policies and rules hold")
    left, right = figure.subplots(1, 2)
    style_axes(left, ylabel="share held")
    names = [f"{r}, {s}" for r, s in zip(table["recipe"], table["seed"], strict=True)]
    for k, place in enumerate(("unseen", "accurate", "kitchen")):
        at = np.arange(len(names)) + 0.25 * (k - 1)
        left.bar(at, table[place], 0.23, color=COLORS[k], label=place)
    left.set_xticks(np.arange(len(names)), names, rotation=30, fontsize=7)
    left.set_ylim(0.0, 1.25)
    left.legend(fontsize=7, frameon=False, ncol=3, loc="upper center")
    style_axes(right, xlabel="standard deviation of the estimate [mm]", ylabel="")
    for k, rule in enumerate(RULES):
        share = np.array([np.mean(played[rule, noise]) for noise in NOISES])
        limits = np.array([bounds[rule, noise] for noise in NOISES])
        errors = np.abs(limits - share[:, None]).T
        x = 1e3 * np.array(NOISES)
        right.errorbar(x, share, errors, color=COLORS[k], label=rule, capsize=2)
    right.set_ylim(0.0, 1.05)
    right.legend(fontsize=7, frameon=False, loc="lower left")
    return figure
