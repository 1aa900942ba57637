"""Measures of grasps as rewards: from which of them does a policy learn soonest?

The same learner plays the same environment, GraspOneShot, once for each reward. What a
policy has learned is judged by shakes of objects that it has never seen, whatever its
reward was. Measures are taken after the lift, before the shake: a robot that learns
from one of them need not shake anything.
"""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.random import default_rng

from drake_srg.envs.grasp_one_shot import GraspOneShotEnv
from drake_srg.envs.rewards import success_reward
from drake_srg.experiments.kept_trials import KeptTrials
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.experiments.shaken_grasp import read_grasp
from drake_srg.learning.cross_entropy import best_action
from drake_srg.learning.episodes import EVALUATION, training_seed
from drake_srg.learning.network import Array
from drake_srg.learning.q_learner import QConfig, QLearner
from drake_srg.planning.grasps.grasp_measures import MEASURES
from drake_srg.recording.figure import COLORS, make_figure, style_axes
from drake_srg.sweeps.statistics import wilson_interval

# Rewards that are no measures: 1 for an object that survives the shake, 1 for one that
# is lifted, and the progress towards lifting.
SHAKE, LIFT, PROGRESS = "shake", "lift", "progress"
_MEASURES = (
    "force closure",
    "epsilon, patches",
    "epsilon, forces",
    "resisted acceleration",
    "friction margin",
    "slip margin",
)
REWARDS = (SHAKE, LIFT, PROGRESS, *_MEASURES)
# Episodes after which a policy is judged on the way, and by how many.
_CHECKS, _CHECK_EPISODES = (120, 160, 200), 25
# Of 100 unseen objects, what the reward of the shake itself must reach.
_ASKED = 0.95


@dc.dataclass(frozen=True)
class Grasp:
    """What came of an episode.

    Attributes:
        survived: Whether the object survived the shake.
        values: What each reward gives; measures in their own units.
    """

    survived: bool
    values: Mapping[str, float]


class MeasuredGraspEnv(GraspOneShotEnv):
    """GraspOneShot, which takes the measures of every grasp that lifts its object."""

    def __init__(self, **keywords: Any) -> None:
        super().__init__(reward=success_reward, **keywords)
        self._measured: dict[str, float] = {}

    def survives_shake(self) -> bool:
        """Take the measures before the shake."""
        patches, body = read_grasp(self.station)
        self._measured = {name: MEASURES[name](patches, body) for name in _MEASURES}
        self._measured[PROGRESS] = self.truth().progress
        return super().survives_shake()

    def play(self, action: Array) -> Grasp:
        """Grasp as an action says; the episode has begun."""
        self._measured = {}
        *_, aborted, info = self.step(action)
        nothing = dict.fromkeys(REWARDS, 0.0)
        if aborted:
            return Grasp(False, nothing)
        survived = bool(info["success"])
        reached = {
            SHAKE: float(survived),
            LIFT: float(bool(self._measured)),
            PROGRESS: self.truth().progress,
        }
        return Grasp(survived, nothing | reached | self._measured)


def learn(
    env: MeasuredGraspEnv,
    reward: str,
    seed: int,
    episodes: int,
    trials: int,
) -> dict[str, Any]:
    """Train a policy from one reward, and judge it.

    Args:
        env: The environment.
        reward: One of `REWARDS`.
        seed: Of training.
        episodes: Of training.
        trials: Shakes that judge the policy in the end.

    Returns:
        `checks`: Episodes and the share that survived, on the way and in the end.
        `survived`: How many survived in the end.
    """
    config = QConfig()
    sizes = len(env.observation_names), len(env.action_names)
    learner = QLearner(*sizes, default_rng(seed))
    # At first, actions are random: those grasps also tell what is much of a measure.
    tried: list[tuple[Array, Array, float]] = []
    scale = 1.0
    checks: list[tuple[int, float]] = []
    survived = 0
    for k in range(episodes):
        env.reset(seed=training_seed(seed, k))
        x = env.state()  # between -1 and 1, as the learner wants it
        action = learner.explore(x)
        tried.append((x, action, env.play(action).values[reward]))
        if k + 1 == config.warm_up:
            scale = usual([value for _, _, value in tried])
        if k + 1 >= config.warm_up:
            for seen, done, value in tried:
                learner.learn(
                    seen,
                    done,
                    value / (value + scale) if reward in MEASURES else value,
                )
            tried = []
        if k + 1 in _CHECKS or k + 1 == episodes:
            last = k + 1 == episodes
            count = trials if last else _CHECK_EPISODES
            first = EVALUATION + (0 if last else trials)
            survived = judge(env, learner, first, count)
            checks.append((k + 1, survived / count))
    return {"checks": checks, "survived": survived}


def usual(values: Sequence[float]) -> float:
    """Return what a measure usually is where it is not 0, which becomes half a reward.

    Rewards between 0 and 1 suit one learner, whatever the unit of a measure.
    """
    positive = [value for value in values if value > 0.0]
    return float(np.median(positive)) if positive else 1.0


def judge(env: MeasuredGraspEnv, learner: QLearner, first: int, count: int) -> int:
    """Return how many of `count` unseen objects survive, seeds from `first` on."""
    survived = 0
    for seed in range(first, first + count):
        env.reset(seed=seed)
        action = best_action(learner.network, env.state(), len(env.action_names))
        survived += env.play(action).survived
    return survived


def run(
    track: Track,
    *,
    runs: int = 3,
    episodes: int = 250,
    trials: int = 100,
    noise: float = 0.01,
    keep: str = "",
) -> ExperimentResult:
    """Train from every reward.

    Args:
        track: Shows progress.
        runs: Trainings from each reward, with seeds 0, 1 and so on.
        episodes: Of a training; the first 100 try random actions.
        trials: Unseen objects that judge a policy.
        noise: Standard deviation of the object's estimated position [m].
        keep: File of finished trainings, with which a run that was cut off goes on.
    """
    env = MeasuredGraspEnv(noise=noise)
    kept = KeptTrials(keep)
    made: dict[str, list[Mapping[str, Any]]] = {reward: [] for reward in REWARDS}
    cases = [(reward, seed) for seed in range(runs) for reward in REWARDS]
    for reward, seed in track(cases, lambda case: f"{case[0]}, seed {case[1]}"):
        name = f"{reward}, seed {seed}, {episodes} episodes, {trials} trials, {noise} m"
        train = functools.partial(learn, env, reward, seed, episodes, trials)
        made[reward].append(kept(name, train))
    rows: list[Row] = []
    for reward, trained in made.items():
        survived = sum(run["survived"] for run in trained)
        low, high = wilson_interval(survived, runs * trials)
        shares = np.array([[share for _, share in run["checks"]] for run in trained])
        early, share = float(shares[:, :-1].mean()), survived / (runs * trials)
        least = float(shares[:, -1].min())
        # Trainings differ more than shakes do.
        rows += [
            Row.at_least(reward, "survived", _ASKED, share, "", spread=0.1)
            if reward == SHAKE
            else Row.info(reward, "survived", share, "", spread=0.1),
            Row.info(reward, "95 % interval, low", low, "", spread=0.1),
            Row.info(reward, "95 % interval, high", high, "", spread=0.1),
            Row.info(reward, "survived, worst training", least, "", spread=0.2),
            Row.info(reward, "survived, while learning", early, "", spread=0.15),
        ]
    table: dict[str, Any] = {
        "reward": [r for r, trained in made.items() for run in trained
                   for _ in run["checks"]],
        "training": [k for trained in made.values() for k, run in enumerate(trained)
                     for _ in run["checks"]],
        "episodes": [n for trained in made.values() for run in trained
                     for n, _ in run["checks"]],
        "survived": [share for trained in made.values() for run in trained
                     for _, share in run["checks"]],
    }  # fmt: skip
    return ExperimentResult(rows, {"checks": table}, _draw(made))


def _draw(made: Mapping[str, Sequence[Mapping[str, Any]]]) -> Any:
    figure = make_figure(
        8.0, 4.0, "Which reward teaches a grasp that survives a shake?"
    )
    axes = figure.subplots()
    style_axes(axes, xlabel="episodes of training", ylabel="share that survived")
    for k, (reward, trained) in enumerate(made.items()):
        at = [n for n, _ in trained[0]["checks"]]
        shares = np.array([[share for _, share in run["checks"]] for run in trained])
        style = "--" if reward in MEASURES else "-"
        color = COLORS[k % len(COLORS)]
        axes.plot(at, shares.mean(axis=0), style, marker="o", color=color, label=reward)
    axes.set_ylim(0.0, 1.02)
    axes.legend(fontsize=8, frameon=False, ncols=2, loc="lower right")
    return figure
