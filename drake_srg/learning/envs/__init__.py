"""Environments to learn grasping in, for gymnasium (docs/learning.md).

Importing this package makes them known::

    import gymnasium

    import drake_srg.learning.envs

    env = gymnasium.make("drake_srg/Pick-v0", physics="train", driver="plant")

`gymnasium.make("drake_srg.learning.envs:drake_srg/Pick-v0")` imports it itself, as the
workers of a vector environment need it.
"""

from __future__ import annotations

import gymnasium

# The scenario of each environment is a keyword like the others.
ENVIRONMENTS: dict[str, tuple[str, str]] = {
    "GraspOneShot-v0": ("GraspOneShotEnv", "learn_bench"),
    "Pick-v0": ("PickEnv", "learn_bench"),
    "KitchenPick-v0": ("PickEnv", "learn_kitchen"),
    "KitchenPickPlace-v0": ("PickPlaceEnv", "learn_kitchen"),
}


def register_envs() -> None:
    """Make the environments known to gymnasium, in the namespace `drake_srg`."""
    for name, (kind, scenario) in ENVIRONMENTS.items():
        env_id = f"drake_srg/{name}"
        if env_id not in gymnasium.registry:
            gymnasium.register(
                env_id,
                entry_point=f"drake_srg.learning.envs.tasks:{kind}",
                kwargs={"scenario": scenario},
            )


register_envs()
