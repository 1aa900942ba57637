"""PickPlace: as Pick, and on to a place on the table."""

from __future__ import annotations

import dataclasses as dc
from typing import ClassVar

import numpy as np

from drake_srg.envs.hand_env import State, clipped
from drake_srg.envs.pick import PickEnv
from drake_srg.envs.rewards import Truth

# The object stands at its goal: within this distance [m], slower than this [m/s], and
# touched by no finger.
_TOLERANCE, _AT_REST = 0.02, 0.01
_FAR = 0.6  # what the goal's entries of the observation are 1 for [m]


class PickPlaceEnv(PickEnv):
    """Carries the object to `task.place.position`, and lets go of it.

    Action and observation are those of `PickEnv`, with the goal relative to the hand at
    the end. Success: the object stands within 2 cm of the goal, free of the hand.
    """

    max_steps: ClassVar[int] = 200
    observation_names = (*PickEnv.observation_names, "goal_x", "goal_y")

    def state(self) -> State:
        """See `PickEnv`."""
        goal = clipped((self.goal - self.hand()[:2]) / _FAR)
        return np.concatenate([super().state(), goal])

    def truth(self) -> Truth:
        """See `HandTask`; half of the progress is that towards the goal."""
        truth = super().truth()
        away = np.linalg.norm(truth.station.X_WO().translation()[:2] - self.goal)
        near = 1.0 - np.tanh(4.0 * away)
        progress = 0.5 * truth.progress + 0.5 * float(near)
        return dc.replace(truth, progress=progress)

    def finish(self, truth: Truth) -> bool:
        """Return whether the object stands at its goal."""
        p_WO = truth.station.X_WO().translation()
        self.success = bool(
            np.linalg.norm(p_WO[:2] - self.goal) < _TOLERANCE
            and abs(truth.height) < 0.005
            and truth.touching == 0.0
            and truth.station.speed() < _AT_REST
        )
        return self.success
