"""Configuration and memory of the planner of two arms that carry an object together."""

import dataclasses as dc
import enum
from typing import ClassVar

from drake_srg.config import positive
from drake_srg.planning.planner_machine import PlannerConfig


@dc.dataclass(kw_only=True)
class CarryTogether(PlannerConfig):
    """Has two `arms` carry the object `task.pick`, which is too wide for one hand.

    The object has a wall at both ends of its x. Each hand takes one of them from above.
    """

    # Names among `arms`.
    first: str = "left"
    second: str = "right"
    # Once both hands hold the object, their set-points move to where the hands are, in
    # this time [s]. The hands then no longer pull against each other.
    settle_time: float = dc.field(default=0.3, metadata=positive())

    # Depth below the support at which the object's set-point ends [m]. Compliant arms
    # then press the object on its support: 4 mm are some 15 N per hand of the iiwa. So
    # it does not shift when one opening finger leaves it before the other.
    # `place_height` is ignored.
    press_depth: float = dc.field(default=0.004, metadata={"ge": 0.0, "le": 0.02})

    several_arms: ClassVar[bool] = True


class CarryMode(enum.Enum):
    """The mode between the check of the grasp and the lift."""

    SETTLE = "settle"
