"""GraspOneShot: one action is one grasp."""

from __future__ import annotations

from typing import Any

import numpy as np

from drake_srg.envs.episode_station import SimulationError
from drake_srg.envs.hand_env import HandEnv, State, Step, clipped
from drake_srg.envs.hand_task import LOWEST, ObjectLostError
from drake_srg.envs.rewards import LIFTED

# Control periods of each part of the grasp: 0.75 s down, 0.75 s to close, 0.56 s up.
_DOWN, _CLOSE, _UP = 16, 16, 12
_REACH = 0.04  # around the estimated position [m]
HEIGHTS = (LOWEST, 0.115)  # of the grasp centre above the table [m]
_MOST_PRESHAPE = 0.45


class GraspOneShotEnv(HandEnv):
    """Chooses a whole grasp at once; an episode has a single step.

    Action: x and y of the grasp centre from the estimated position (1 is 4 cm), its
    height above the table (2.5 .. 11.5 cm), the yaw from the object's (1 is 90
    degrees), the closure on the way down (0 .. 0.45), and the closure of the grasp
    (0 .. 1). The hand comes down, closes, lifts and shakes.
    """

    action_names = ("x", "y", "height", "yaw", "preshape", "closure")
    observation_names = ("size_x", "size_y", "size_z", "round")

    def state(self) -> State:
        """Return the object's size, 1 for 0.15 m, and whether it is round."""
        size = self.scene.shape.bounding_size / 0.15
        return clipped(np.append(size, self.scene.is_round))

    def step(self, action: Any) -> Step:
        """Grasp, lift and shake."""
        a = np.clip(np.asarray(action, dtype=float), -1.0, 1.0)
        estimate = self.estimate
        height = HEIGHTS[0] + 0.5 * (a[2] + 1.0) * (HEIGHTS[1] - HEIGHTS[0])
        yaw = estimate[3] + a[3] * 0.5 * np.pi
        xy = estimate[:2] + _REACH * a[:2]
        over = self.over(xy, yaw)
        grasp = np.array([*xy, self.table + height, yaw])
        preshape = _MOST_PRESHAPE * 0.5 * (a[4] + 1.0)
        closure = 0.5 * (a[5] + 1.0)
        try:
            self.begin(self.scene, self.joints_at(over))
            self.move(grasp, preshape, _DOWN)
            self.move(grasp, closure, _CLOSE)
            up = np.array([*grasp[:2], grasp[2] + LIFTED + 0.02, yaw])
            self.move(up, closure, _UP)
            if self.truth().height > LIFTED:
                self.success = self.survives_shake()
        except ObjectLostError:
            pass
        except SimulationError as error:
            return self.failed_step(error)
        self.lost = not self.success
        truth = self.truth()
        reward = self._reward(None, truth)
        return self.observe(), reward, True, False, self.info(truth)
