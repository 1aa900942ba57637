"""The grasp manager of SAKE's driver: when a closing hand holds something.

States, thresholds and forces are those of its default configuration
(SAKErobotics/unitree-dex1-ezgripper-driver). Positions are SAKE's percent: 100 open,
0 closed, in 2500 counts of the servo. Forces are percent of the current limit.
"""

from __future__ import annotations

import dataclasses as dc
import enum

_STALL = 2.0  # positions this close together count as standing still [%]
_STALL_AT_ZERO = 0.04  # the same where the fingers meet: one count [%]
_BLOCKED = 5.0  # this far from the goal, something blocks the fingers [%]
_AT_ZERO = 1.0  # goals and positions up to here count as closed [%]
_SAMPLES = 3  # positions that are compared, and how often they must be close
_CHANGE = 1.0  # a smaller change of the position does not count [%]


class GraspState(enum.IntEnum):
    """State of a grasp, numbered as in the driver's messages."""

    IDLE = 0
    MOVING = 1
    CONTACT = 2
    GRASPING = 3


FORCES = {
    GraspState.IDLE: 10.0,
    GraspState.MOVING: 50.0,
    GraspState.CONTACT: 20.0,
    GraspState.GRASPING: 15.0,
}


@dc.dataclass(frozen=True)
class Grasp:
    """The manager's memory from cycle to cycle.

    Attributes:
        state: The state.
        goal: The position to go to [%].
        commanded: The last commanded position [%]; None before the first.
        recent: The last positions while it closes, newest last [%].
        stalls: Cycles in a row in which the fingers stood still.
        grasped: The command in force when the grasp began [%].
    """

    state: GraspState = GraspState.IDLE
    goal: float = 0.0
    commanded: float | None = None
    recent: tuple[float, ...] = ()
    stalls: int = 0
    grasped: float = 0.0

    def next(self, commanded: float, position: float) -> Grasp:
        """Return what follows in the next cycle.

        The manager runs at 30 Hz. Only closing fingers can touch something. A grasp
        ends with a command to open further than the one that began it; any other
        command leaves it as it is.

        Args:
            commanded: The commanded position [%].
            position: The measured position [%].
        """
        grasp = self._look(commanded, position)
        state, grasped = self.state, self.grasped
        way = abs(commanded - position)
        match state:
            case GraspState.IDLE if way > _CHANGE:
                state = GraspState.MOVING
            case GraspState.MOVING if grasp.stalls >= _SAMPLES:
                state = GraspState.CONTACT
            case GraspState.MOVING if way < _CHANGE and self._opens(commanded):
                state = GraspState.IDLE
            case GraspState.CONTACT:
                state, grasped = GraspState.GRASPING, commanded
            case GraspState.GRASPING if commanded > grasped + _CHANGE:
                state = GraspState.MOVING
        if state is GraspState.IDLE:
            goal = position
        elif state is GraspState.CONTACT:
            goal = position if self.state is GraspState.MOVING else self.goal
        else:
            goal = commanded
        return dc.replace(
            grasp, state=state, goal=goal, commanded=commanded, grasped=grasped
        )

    def _opens(self, commanded: float) -> bool:
        return self.commanded is not None and commanded > self.commanded

    def _look(self, commanded: float, position: float) -> Grasp:
        """Return this grasp with another position, and the stalls counted."""
        closed = commanded < _AT_ZERO and position <= _AT_ZERO
        if self.state is not GraspState.MOVING or not (commanded < position or closed):
            return dc.replace(self, stalls=0)
        recent = (*self.recent, position)[-_SAMPLES:]
        spread = max(recent) - min(recent)
        blocked = spread < _STALL and abs(commanded - position) > _BLOCKED
        stalled = blocked or (closed and spread < _STALL_AT_ZERO)
        if len(recent) < _SAMPLES or not stalled:
            return dc.replace(self, recent=recent, stalls=0)
        return dc.replace(self, recent=recent, stalls=self.stalls + 1)
