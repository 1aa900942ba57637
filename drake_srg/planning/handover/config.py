"""Configuration and memory of the planner that hands an object over."""

import dataclasses as dc
import enum
from typing import ClassVar

import numpy as np

from drake_srg.config import positive
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.pick_and_place.knowledge import (
    Attempt,
    Grip,
    PlannerMemory,
    Senses,
)
from drake_srg.planning.planner_machine import PlannerConfig
from drake_srg.planning.state_machine import Memory
from drake_srg.types import Vector


@dc.dataclass(kw_only=True)
class Handover(PlannerConfig):
    """Has one of two `arms` pick the object `task.pick`, and the other one place it.

    The giver takes the object, a standing cylinder, by its upper end and presents it in
    the air. The receiver takes its lower end from the side.
    """

    # Names among `arms`: the one that picks the object, and the one that sets it down.
    giver: str = "left"
    receiver: str = "right"
    # Height of the receiver's grasp above the object's lower end [m]: when a hand from
    # the side sets the object down, its wrist must clear the table.
    grip_height: float = dc.field(default=0.1, metadata=positive())
    # The giver lets go once the force along the receiver's pull exceeds the force
    # before the pull by this much [N]. The pull ends after this distance [m], at this
    # speed [m/s].
    pull_force: float = dc.field(default=4.0, metadata=positive())
    pull_distance: float = dc.field(default=0.008, metadata=positive())
    pull_speed: float = dc.field(default=0.01, metadata=positive())
    # Time constant of the filter of the giver's force [s].
    pull_time: float = dc.field(default=0.05, metadata=positive())
    # Largest number of the receiver's attempts to take the presented object.
    max_takes: int = dc.field(default=2, metadata={"ge": 1})

    several_arms: ClassVar[bool] = True

    @property
    def feels(self) -> bool:
        """Whether the planner needs the external torques of its arms."""
        return True


class HandoverMode(enum.Enum):
    """Modes from the giver's lift to the receiver's."""

    CARRY = "carry"
    PRESENT = "present"
    APPROACH = "approach"
    REACH = "reach"
    TAKE = "take"
    PULL = "pull"
    LET_GO = "let_go"
    WITHDRAW = "withdraw"
    CLEAR = "clear"
    SECURE = "secure"
    RAISE = "raise"


@dc.dataclass
class Side(Memory):
    """The memory of the idle arm."""

    motion: Motion
    closure: float = 0.0
    attempt: Attempt = dc.field(default_factory=Attempt)
    grip: Grip = dc.field(default_factory=Grip)


@dc.dataclass
class HandoverMemory(PlannerMemory):
    """The planner's memory.

    `motion`, `closure`, `attempt` and `grip` belong to the arm whose turn it is, first
    to the giver.
    """

    other: Side = dc.field(default_factory=lambda: Side(Motion(np.zeros(0))))
    receiving: bool = False  # whether it is the receiver's turn
    arms: tuple[str, str] = ("left", "right")  # names of the giver and the receiver
    takes: int = 0  # the receiver's attempts during the giver's present one
    taken: bool = False  # the giver has felt the receiver's pull and let go
    # The giver's external torques as the pull begins, and now, (N,) [N m].
    torque_before: Vector = dc.field(default_factory=lambda: np.zeros(0))
    torque: Vector = dc.field(default_factory=lambda: np.zeros(0))

    def commands(self, arm: str) -> tuple[Motion, float]:
        """Return the motion and the commanded closure of an arm, by its name."""
        side = self if (arm == self.arms[1]) == self.receiving else self.other
        return side.motion, side.closure

    def turn_to(self, *, receiver: bool) -> None:
        """Give the turn to an arm."""
        if receiver == self.receiving:
            return
        rests = Side(self.motion, self.closure, self.attempt, self.grip)
        mine = self.other
        self.motion, self.closure = mine.motion, mine.closure
        self.attempt, self.grip = mine.attempt, mine.grip
        self.other, self.receiving = rests, receiver


@dc.dataclass(frozen=True)
class HandoverSenses(Senses):
    """Measurements of the arm whose turn it is, and of the other one."""

    other: Senses | None = None
