"""The messages between the control loop and the planner's process."""

from __future__ import annotations

import abc
import dataclasses as dc
from collections.abc import Sequence

from drake_srg.bridges.commands import PortValues
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.servoing.sightings import Sighting
from drake_srg.servoing.status import ServoCommand, ServoStatus
from drake_srg.types import Mode, PlannerStatus


@dc.dataclass(frozen=True)
class Tick:
    """What the planner gets to know, one period of its clock after the tick before.

    Attributes:
        values: Measurements by output port of the station, with the robot's clock.
        servo: The visual servo's report, if there is one.
    """

    values: PortValues
    servo: ServoStatus | None = None


@dc.dataclass(frozen=True)
class Answer:
    """What the planner commands and reports after a tick.

    Attributes:
        time: The planner's clock [s]; `motion` refers to it.
        motion: The arm's motion; None: the one before goes on.
        closure: Of the gripper, 0 open .. 1 closed.
        status: The report on the task.
        command: To the visual servo, if there is one.
        sighting: What a new picture of its camera shows; None: there is no new one.
        planning_wall: What planning has taken so far on the wall clock [s].
    """

    time: float
    motion: Motion | None
    closure: float
    status: PlannerStatus
    command: ServoCommand = ServoCommand.PASS
    sighting: Sighting | None = None
    planning_wall: float = 0.0

    @property
    def mode(self) -> Mode:
        """The planner's mode."""
        return self.status.mode


@dc.dataclass(frozen=True)
class Ended:
    """The planner's process has ended, and there will be no more answers.

    Attributes:
        reason: Why, in words.
    """

    reason: str


class PlannerLink(abc.ABC):
    """Connects the control loop with a planner. Both methods return at once."""

    @abc.abstractmethod
    def post(self, tick: Tick) -> None:
        """Send a tick, or drop it while the planner is busy with earlier ones."""

    @abc.abstractmethod
    def take(self) -> Sequence[Answer | Ended]:
        """Return what has arrived since the last call, in order."""
