"""Environments that take no time, with the spaces and the `info` of ours."""

import gymnasium
import numpy as np

WITHIN = 0.3


class Toy(gymnasium.Env):
    """One step: the action must hit the point in the observation."""

    def __init__(self, *, size=2, steps=1, driver="plant"):
        self.observation_space = gymnasium.spaces.Box(-2.0, 4.0, (size,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (size,), np.float32)
        self.steps, self.driver = steps, driver

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self._target = self.np_random.uniform(-0.8, 0.8, self.action_space.shape)
        self._left = self.steps
        return self._observed(), {}

    def step(self, action):
        self._left -= 1
        hit = bool(np.abs(action - self._target).max() < WITHIN)
        info = {"success": hit}
        return self._observed(), float(hit), self._left == 0, False, info

    def rule(self, observation):
        """Always hit."""
        return ((observation - 1.0) / 3.0).astype(np.float32)

    def _observed(self):
        return (1.0 + 3.0 * self._target).astype(np.float32)


for id_, keywords in (("toy/Hit-v0", {}), ("toy/Hits-v0", {"steps": 3})):
    if id_ not in gymnasium.registry:
        gymnasium.register(id_, Toy, kwargs=keywords)
