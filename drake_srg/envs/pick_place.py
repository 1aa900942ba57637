"""PickPlace: as Pick, and on to a place on the table."""

from __future__ import annotations

import dataclasses as dc
from typing import ClassVar

import numpy as np

from drake_srg.envs.hand_env import State, clipped
from drake_srg.envs.pick import PickEnv
from drake_srg.envs.rewards import Truth
from drake_srg.envs.scenes import Scene
from drake_srg.types import Vector

# The object stands at its goal for so many control periods: within this distance [m],
# this far from the table [m], upright by the cosine of its lean, and touched by no
# finger. In the long steps of `train`, what stands there never comes to rest: it
# bounces by millimetres.
_STANDS, _TOLERANCE, _LIFT, _UPRIGHT = 8, 0.02, 0.01, np.cos(np.deg2rad(15.0))
_FAR = 0.6  # what the goal's entries of the observation are 1 for [m]


class PickPlaceEnv(PickEnv):
    """Carries the object to `task.place.position`, and lets go of it.

    Action and observation are those of `PickEnv`, with the goal relative to the hand at
    the end. Success: for 0.4 s, the object stands within 2 cm of the goal, free of the
    hand.
    """

    max_steps: ClassVar[int] = 200
    places: ClassVar[bool] = True
    judges_lift: ClassVar[bool] = False
    train_steps: ClassVar[int] = 4
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

    def begin(self, scene: Scene, q: Vector) -> None:
        """See `HandTask`."""
        super().begin(scene, q)
        self._standing = 0  # control periods in a row

    def finish(self, truth: Truth) -> bool:
        """Return whether the object has stood at its goal for long enough."""
        X_WO = truth.station.X_WO()
        stands = (
            np.linalg.norm(X_WO.translation()[:2] - self.goal) < _TOLERANCE
            and abs(truth.height) < _LIFT
            and X_WO.rotation().matrix()[2, 2] > _UPRIGHT
            and truth.touching == 0.0
        )
        self._standing = self._standing + 1 if stands else 0
        self.success = self._standing >= _STANDS
        return self.success
