"""Our environments for LeRobot's EnvHub: a repository there needs this file alone.

    from lerobot.envs.factory import make_env

    envs = make_env("you/drake-srg", n_envs=4, trust_remote_code=True)

`pip install drake_srg` must have been run. docs/lerobot.md has the other way, without
a repository.
"""

from drake_srg.learning.envs.lerobot_env import make_env

__all__ = ["make_env"]
