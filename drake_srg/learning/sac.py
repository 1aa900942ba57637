"""Soft actor-critic by Stable-Baselines3: the extra `learn`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from stable_baselines3 import SAC

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.learning.episodes import training_seed
from drake_srg.learning.network import Network
from drake_srg.learning.policy import Kind
from drake_srg.recording.output import OutputFile

_MODEL, _BUFFER, _COUNTS = "sac.zip", "replay.pkl", "counts.npz"
# Of Haarnoja et al., 2018, but for the learning rate and the discount: episodes of a
# few dozen steps that end in one reward.
OPTIONS = {
    "learning_rate": 1e-3,
    "gamma": 0.98,
    "batch_size": 256,
    "learning_starts": 500,
    "buffer_size": 200_000,
}
_HIDDEN = [256, 256]


class SacRounds:
    """SAC in rounds; see `drake_srg.learning.train.Learner`.

    Args:
        env: The environment.
        run: Seed of training.
    """

    def __init__(self, env: Any, run: int) -> None:
        self.steps, self.episodes, self.round_steps = 0, 0, 1000
        self.run = run
        self._env = _Seeded(env, self)
        self._model = SAC(
            "MlpPolicy",
            _scaled(self._env),
            seed=run,
            device="cpu",
            policy_kwargs={"net_arch": _HIDDEN},
            **OPTIONS,
        )
        self.done: list[bool] = []

    def advance(self, steps: int) -> list[bool]:
        """See `Learner`."""
        self.done = []
        begun = self._model.num_timesteps == 0
        # Validation has used the environment since, so the last episode is over.
        self._model.set_env(self._model.get_env(), force_reset=True)
        self._model.learn(steps, reset_num_timesteps=begun)
        self.steps = int(self._model.num_timesteps)
        return self.done

    def policy(self) -> tuple[Kind, Network]:
        """Return the actor's mean as a network."""
        actor = self._model.policy.actor
        layers = [*actor.latent_pi, actor.mu]
        arrays = [
            (
                layer.weight.detach().numpy().T[None],
                layer.bias.detach().numpy()[None, None],
            )
            for layer in layers
            if hasattr(layer, "weight")
        ]
        weights, biases = zip(*arrays, strict=True)
        return "actor", Network(
            [np.array(w, np.float32) for w in weights],
            [np.array(b, np.float32) for b in biases],
        )

    def save(self, folder: Path) -> None:
        """Write model and replay buffer, which is Stable-Baselines3's own pickle.

        All files replace the last ones together, once they are complete.
        """
        model, buffer, counts = (
            OutputFile(folder / name) for name in (_MODEL, _BUFFER, _COUNTS)
        )
        self._model.save(model.path)
        self._model.save_replay_buffer(buffer.path)
        np.savez(counts.path, episodes=self.episodes)
        for file in (model, buffer, counts):
            file.commit()

    def restore(self, folder: Path) -> None:
        """Go on from what `save` wrote. Restore only files that you trust.

        Raises:
            ScenarioError: If the files are missing or broken.
        """
        try:
            self._model = SAC.load(
                folder / _MODEL, env=_scaled(self._env), device="cpu"
            )
            self._model.load_replay_buffer(folder / _BUFFER)
            with np.load(folder / _COUNTS) as counts:
                self.episodes = int(counts["episodes"])
        except Exception as error:  # whatever unpickling raises
            raise ScenarioError(
                f"{folder}: --resume: cannot be read: {one_line(error)}"
            ) from None
        self.steps = int(self._model.num_timesteps)


class _Seeded(gymnasium.Wrapper):
    """An environment whose episodes have the learner's seeds, and are counted by it."""

    def __init__(self, env: Any, learner: SacRounds) -> None:
        super().__init__(env)
        self._learner = learner

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        """Begin the learner's next episode; its seed replaces `seed`."""
        wanted = training_seed(self._learner.run, self._learner.episodes)
        return self.env.reset(seed=wanted, options=options)

    def step(self, action: Any) -> Any:
        """Take a step, and tell the learner of episodes that end."""
        result = self.env.step(action)
        if result[2] or result[3]:
            self._learner.episodes += 1
            self._learner.done.append(bool(result[4].get("success", False)))
        return result


def _scaled(env: Any) -> Any:
    """Return an environment whose observations are scaled as a `Policy` scales them."""
    return gymnasium.wrappers.RescaleObservation(env, np.float32(-1.0), np.float32(1.0))
