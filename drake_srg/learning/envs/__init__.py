"""Environments to learn grasping in, for gymnasium (docs/learning.md).

Importing this package registers them::

    import gymnasium

    import drake_srg.learning.envs

    env = gymnasium.make("drake_srg/Pick-v0", physics="train", driver="plant")

In the workers of a vector environment, let gymnasium import the package:
`gymnasium.make("drake_srg.learning.envs:drake_srg/Pick-v0")`.
"""

from __future__ import annotations

import gymnasium

# Name of each environment to its class in `tasks`, and its default scenario.
ENVIRONMENTS: dict[str, tuple[str, str]] = {
    "GraspOneShot-v0": ("GraspOneShotEnv", "learn_bench"),
    "Pick-v0": ("PickEnv", "learn_bench"),
    "KitchenPick-v0": ("PickEnv", "learn_kitchen"),
    "KitchenPickPlace-v0": ("PickPlaceEnv", "learn_kitchen"),
}


def register_envs() -> None:
    """Register the environments with gymnasium, in the namespace `drake_srg`."""
    for name, (kind, scenario) in ENVIRONMENTS.items():
        env_id = f"drake_srg/{name}"
        if env_id not in gymnasium.registry:
            gymnasium.register(
                env_id,
                entry_point=f"drake_srg.learning.envs.tasks:{kind}",
                kwargs={"scenario": scenario},
            )


register_envs()
