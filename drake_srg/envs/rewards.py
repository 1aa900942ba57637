"""What happened in an episode, and rewards for it."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Mapping

import numpy as np

from drake_srg.envs.episode_station import EpisodeStation
from drake_srg.envs.scenes import Scene

# Height of the object's underside at which it counts as lifted [m].
LIFTED = 0.1


@dc.dataclass(frozen=True)
class Truth:
    """Ground truth after a step; rewards and `info` read it, observations do not.

    Attributes:
        reach: Distance of the hand's grasp centre from the object's centre [m].
        height: Of the object's underside above the table [m].
        touching: Share of the fingers that touch something, 0 .. 1.
        progress: How near the task is to being done, 0 .. 1.
        success: Whether the task is done.
        lost: Whether the episode cannot succeed any more.
        scene: The episode's object.
        station: For rewards that look at contacts; its state is the present one.
    """

    reach: float
    height: float
    touching: float
    progress: float
    success: bool
    lost: bool
    scene: Scene
    station: EpisodeStation


def pick_progress(reach: float, touching: float, height: float) -> float:
    """Return how near an object is to being lifted, 0 .. 1; see `Truth`."""
    near = 1.0 - np.tanh(10.0 * reach)
    lifted = min(max(height / LIFTED, 0.0), 1.0)
    return float(0.3 * near + 0.2 * touching + 0.5 * lifted)


# Of the truth before (None: at the start of a single-step episode) and after a step.
Reward = Callable[[Truth | None, Truth], float]


def success_reward(before: Truth | None, after: Truth) -> float:
    """Return 1 for success, else 0."""
    del before
    return float(after.success)


def shaped_reward(before: Truth | None, after: Truth) -> float:
    """Return 1 for success, plus the progress made.

    Progress is a potential, so it leaves the best policy as it is (A. Y. Ng, D. Harada,
    S. Russell, ICML 1999).
    """
    start = before.progress if before is not None else 0.0
    return float(after.success) + after.progress - start


REWARDS: Mapping[str, Reward] = {"shaped": shaped_reward, "success": success_reward}
