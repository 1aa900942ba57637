"""Makes drake_srg's tasks known to LeRobot, which imports this by its name.

Once this distribution is installed, LeRobot's commands know `--env.type=drake_srg`.
"""

from drake_srg.suite.lerobot import DrakeSrgSuite

__all__ = ["DrakeSrgSuite"]
