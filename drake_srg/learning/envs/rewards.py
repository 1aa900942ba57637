"""The ground truth of an episode's steps, and rewards computed from it."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Mapping

import numpy as np

from drake_srg.learning.envs.episode_station import EpisodeStation
from drake_srg.learning.envs.scenes import Scene
from drake_srg.planning.grasps.grasp_measures import MEASURES
from drake_srg.station.held_grasp import HeldGrasp

# Height of the object's underside at which it counts as lifted [m].
LIFTED = 0.1


@dc.dataclass(frozen=True)
class Truth:
    """Ground truth after a step; rewards and `info` read it, observations do not.

    Attributes:
        reach: Distance of the hand's grasp centre from the object's centre [m].
        height: Height of the object's underside above the table [m].
        touching: Share of the two fingers that touch anything, 0 .. 1.
        progress: Progress of the task, 0 .. 1.
        success: Whether the task is done.
        lost: Whether the episode can no longer succeed.
        scene: The episode's object.
        grasp: The grasp by the lifted hand, before the shake; None if there is no
            grasp.
        station: The station in its present state, for rewards that use contacts.
    """

    reach: float
    height: float
    touching: float
    progress: float
    success: bool
    lost: bool
    scene: Scene
    grasp: HeldGrasp | None
    station: EpisodeStation


def pick_progress(reach: float, touching: float, height: float) -> float:
    """Return the progress of lifting an object, 0 .. 1; see `Truth`."""
    near = 1.0 - np.tanh(10.0 * reach)
    lifted = min(max(height / LIFTED, 0.0), 1.0)
    return float(0.3 * near + 0.2 * touching + 0.5 * lifted)


# Called with the truth before a step (None in a single-step episode) and after it.
Reward = Callable[[Truth | None, Truth], float]


def success_reward(before: Truth | None, after: Truth) -> float:
    """Return 1 for success, else 0."""
    del before
    return float(after.success)


def shaped_reward(before: Truth | None, after: Truth) -> float:
    """Return 1 for success, plus the progress made.

    Lost progress is subtracted again, as with a potential (A. Y. Ng, D. Harada, S.
    Russell, ICML 1999). Progress at the end of an episode is kept, so this potential
    may change the best policy.
    """
    start = before.progress if before is not None else 0.0
    return float(after.success) + after.progress - start


def lifted_reward(before: Truth | None, after: Truth) -> float:
    """Return 1 if the hand lifted the object, even if the shake failed, else 0."""
    del before
    return float(after.grasp is not None)


# Values with reward 0.5: medians of 200 grasps of the hand-written rule on the
# training seeds of run 999; None if a measure is within 0 .. 1. The measures of the
# patches' centers are not rewards: epsilon and volume are 0 for four of five grasps
# that hold.
_TYPICAL: Mapping[str, float | None] = {
    "force closure": None,
    "epsilon, patches": 0.12,
    "epsilon, forces": 0.18,
    "volume, patches": 0.045,
    "volume, forces": 62.0,
    "resisted acceleration": 75.0,  # m/s²
    "friction margin": 16.0,
    "slip margin": None,
}


def measure_reward(name: str) -> Reward:
    """Return a reward from a measure of the lifted grasp, 0 .. 1.

    A measure m gives m / (m + its typical value), which is bounded and increases with
    m. An object that was not lifted gives 0. The shake does not count.

    Args:
        name: One of `MEASURES` with a typical value.
    """
    measure, typical = MEASURES[name], _TYPICAL[name]

    def reward(before: Truth | None, after: Truth) -> float:
        del before
        value = 0.0 if after.grasp is None else measure(*after.grasp)
        if typical is None:
            return value
        return value / (value + typical)

    return reward


# Rewards that need no lift.
STEP_REWARDS: Mapping[str, Reward] = {
    "shaped": shaped_reward,
    "success": success_reward,
}
REWARDS: Mapping[str, Reward] = {
    **STEP_REWARDS,
    "lifted": lifted_reward,
    **{
        name.replace(",", "").replace(" ", "_"): measure_reward(name)
        for name in _TYPICAL
    },
}
