"""Rewards for learning to grasp: which learns fastest, and whose policy holds on.

The same learner learns the same one-shot grasp with each reward. Success is always
judged by the shake, also where the reward knows nothing of it. The final policies grasp
unseen objects, and then heavy and slippery ones, for which no policy was trained.
"""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from drake_srg.experiments.kept_trials import KeptTrials
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.learning.episodes import EVALUATION, make_environment, run_episode
from drake_srg.learning.train import MakeLearner, Training, trained_policy
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.sweeps.statistics import wilson_interval
from drake_srg.types import Vector

_SHAKEN = "success"  # the reward that is the shake itself
REWARDS = (
    _SHAKEN,
    "shaped",
    "lifted",
    "force_closure",
    "epsilon_patches",
    "epsilon_forces",
    "volume_patches",
    "resisted_acceleration",
    "friction_margin",
    "slip_margin",
)
_ENVIRONMENT = "GraspOneShot"
# Twice the heaviest object of training, and less than half the least friction: the
# hand-written rule holds two of three of them.
_MASS, _FRICTION = 0.8, 0.2
_HARD = [
    f"clutter.kinds.{kind}.{key}={value}"
    for kind in ("box", "cylinder")
    for key, value in (("mass", _MASS), ("friction", _FRICTION))
]
# A reward has been learned from once this share of so many episodes in a row succeeds,
# exploration included.
_LEARNED, _WINDOW = 0.9, 40
# What the shake's own policy must reach, and how far behind it the best policy that
# never saw a shake may be.
_LEAST, _BEHIND = 0.9, 0.05


@dc.dataclass(frozen=True)
class Trial:
    """A training: a reward and a seed."""

    reward: str
    seed: int

    def __str__(self) -> str:
        return f"{self.reward}, seed {self.seed}"


@dc.dataclass(frozen=True)
class Learned:
    """What became of a training.

    Attributes:
        training: Successes of its episodes, in order.
        unseen: Successes of the final policy with objects like those of training.
        hard: The same with heavy and slippery objects.
    """

    training: list[bool]
    unseen: list[bool]
    hard: list[bool]

    @property
    def episodes(self) -> int | None:
        """Episodes until it had learned; None: it never did."""
        done = np.convolve(self.training, np.ones(_WINDOW), "valid") / _WINDOW
        reached = np.flatnonzero(done >= _LEARNED)
        return int(reached[0]) + _WINDOW if len(reached) else None


def run(
    track: Track,
    *,
    episodes: int = 300,
    seeds: int = 3,
    trials: int = 70,
    keep: str = "",
) -> ExperimentResult:
    """Train with every reward and seed, and judge the final policies.

    Args:
        track: Shows progress.
        episodes: Of each training, of which the first 100 are random.
        seeds: Trainings with each reward.
        trials: Grasps of each policy of unseen objects, and as many of hard ones.
        keep: File of finished trials, with which a run that was cut off goes on.
    """
    kept = KeptTrials(keep)
    made: dict[str, list[Learned]] = {reward: [] for reward in REWARDS}
    for trial in track([Trial(r, seed) for seed in range(seeds) for r in REWARDS]):
        name = f"{trial}, {episodes} episodes, {trials} trials"
        plain = kept(name, functools.partial(_train, trial, episodes, trials))
        made[trial.reward].append(Learned(**plain))
    return judged(made, episodes)


# The last bits depend on the number of threads.
@threadpool_limits.wrap(limits=1)
def _train(trial: Trial, episodes: int, trials: int) -> Mapping[str, Any]:
    """Train once, and return a `Learned` as plain values."""
    keywords = {"reward": trial.reward}
    env = make_environment(_ENVIRONMENT, keywords)
    learner = MakeLearner("q", env, trial.seed)
    training = learner.advance(episodes)
    policy = trained_policy(
        learner, env, Training(environment=_ENVIRONMENT, keywords=keywords)
    )
    hard = make_environment(_ENVIRONMENT, {**keywords, "overrides": _HARD})
    first = EVALUATION + trial.seed * trials
    unseen, held = (
        [run_episode(e, policy, first + k).success for k in range(trials)]
        for e in (env, hard)
    )
    return {"training": training, "unseen": unseen, "hard": held}


def judged(made: Mapping[str, Sequence[Learned]], episodes: int) -> ExperimentResult:
    """Compare the rewards.

    Args:
        made: The trainings with each reward.
        episodes: Of each training.
    """
    rows: list[Row] = []
    shares: dict[str, float] = {}
    until: dict[str, list[int]] = {}
    for reward, learned in made.items():
        reached = [one.episodes for one in learned]
        until[reward] = [episodes if n is None else n for n in reached]
        count = sum(n is not None for n in reached)
        rows += [
            Row.info(
                reward,
                "episodes until 90 % succeed, median",
                float(np.median(until[reward])),
                "",
                spread=0.2 * episodes,
            ),
            Row.info(reward, "trainings that reach 90 %", count, "", spread=1.0),
        ]
        for what in ("unseen", "hard"):
            done = [held for one in learned for held in getattr(one, what)]
            share, (low, high) = np.mean(done), wilson_interval(sum(done), len(done))
            rows += [
                Row.info(reward, f"held, {what}", float(share), "", spread=0.1),
                Row.info(reward, f"held, {what}, at least", low, "", spread=0.1),
                Row.info(reward, f"held, {what}, at most", high, "", spread=0.1),
            ]
            if what == "unseen":
                shares[reward] = float(share)
    best = max(shares[name] for name in shares if name not in (_SHAKEN, "shaped"))
    rows += [
        Row.at_least(
            "the shake as reward", "held, unseen", _LEAST, shares[_SHAKEN], ""
        ),
        Row.at_least(
            "best reward without a shake",
            "held, unseen, more than with a shake",
            -_BEHIND,
            best - shares[_SHAKEN],
            "",
            spread=0.05,
        ),
    ]
    table: dict[str, Any] = {
        "reward": [r for r, learned in made.items() for _ in learned],
        "seed": [seed for learned in made.values() for seed in range(len(learned))],
        "episodes until 90 %": [n for counts in until.values() for n in counts],
        "held, unseen": [np.mean(x.unseen) for xs in made.values() for x in xs],
        "held, hard": [np.mean(x.hard) for xs in made.values() for x in xs],
    }
    return ExperimentResult(rows, {"trainings": table}, _draw(made))


def _draw(made: Mapping[str, Sequence[Learned]]) -> Any:
    figure = make_figure(9.0, 4.2, "Which reward teaches a grasp that survives?")
    curves, bars = figure.subplots(1, 2, width_ratios=(1.2, 1.0))
    style_axes(curves, xlabel="episode", ylabel=f"success of the last {_WINDOW}")
    for k, (reward, learned) in enumerate(made.items()):
        rate = np.mean([_recent(one.training) for one in learned], axis=0)
        style = "-" if k < len(COLORS) else "--"
        color = COLORS[k % len(COLORS)]
        at = _WINDOW + np.arange(len(rate))
        curves.plot(at, rate, style, color=color, lw=1.2, label=_words(reward))
    curves.axhline(_LEARNED, color="black", lw=0.8, ls=":")
    curves.set_ylim(0.0, 1.02)
    curves.legend(fontsize=7, frameon=False, loc="lower right")
    style_axes(bars, xlabel="share held by the final policies", ylabel="")
    at = np.arange(len(made))[::-1]
    for k, what in enumerate(("unseen", "hard")):
        done = [
            [x for one in learned for x in getattr(one, what)]
            for learned in made.values()
        ]
        share = np.array([np.mean(x) for x in done])
        bounds = np.array([wilson_interval(sum(x), len(x)) for x in done])
        off = np.abs(bounds - share[:, None]).T
        y = at + 0.2 - 0.4 * k
        bars.barh(y, share, 0.38, xerr=off, color=COLORS[k], label=what, ecolor="gray")
    bars.set_yticks(at, [_words(reward) for reward in made], fontsize=8)
    bars.set_xlim(0.0, 1.05)
    above = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "ncol": 2}
    bars.legend(fontsize=8, frameon=False, **above)
    return figure


def _recent(training: Sequence[bool]) -> Vector:
    """Return the share of successes of the last episodes, from episode `_WINDOW` on."""
    rates: Vector = np.convolve(training, np.ones(_WINDOW), "valid") / _WINDOW
    return rates


def _words(reward: str) -> str:
    return reward.replace("_", " ")
