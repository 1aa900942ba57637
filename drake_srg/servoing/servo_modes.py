"""The modes of picking and placing in which a visual servo moves the arm."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping
from typing import TypeAlias

from pydrake.trajectories import Trajectory

from drake_srg.planning import state_machine
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.planner_machine import (
    Observation,
    PlannerConfig,
    Table,
    Transitions,
)
from drake_srg.planning.task.knowledge import (
    FATAL,
    TRANSITIONS,
    PlannerMemory,
    Senses,
    Trouble,
)
from drake_srg.planning.task.modes import (
    Close,
    Entry,
    Grasp,
    Lift,
    Now,
    TaskMode,
    Verify,
    task_modes,
)
from drake_srg.planning.task.replanning import Replanner
from drake_srg.servoing.status import (
    ServoCommand,
    ServoFault,
    ServoState,
    ServoStatus,
)
from drake_srg.types import Failure, Mode

# What the servo is told in each mode; it passes in all others.
COMMANDS: Mapping[Mode, ServoCommand] = {
    Mode.GRASP: ServoCommand.TRACK,
    Mode.CLOSE: ServoCommand.FOLLOW,
    Mode.VERIFY: ServoCommand.FOLLOW,
    Mode.LIFT: ServoCommand.RAISE,  # until the motions from there are planned
}
# Those transitions that picking and placing does not have go first.
SERVO_TRANSITIONS: Table = {
    **TRANSITIONS,
    Mode.GRASP: [
        (lambda o, t, c: o.stuck, Mode.RETREAT),
        *TRANSITIONS[Mode.GRASP],
    ],
    Mode.LIFT: [
        (lambda o, t, c: o.failure is not None, Mode.FAILED),
        *TRANSITIONS[Mode.LIFT],
    ],
}
servo_transition = Transitions(SERVO_TRANSITIONS, FATAL)
_HELD = (ServoState.HOLDING, ServoState.FAILED)
_LATE = "it does not reach the object in time"


@dc.dataclass(frozen=True)
class ServoSenses(Senses):
    """Measurements at one time, and what the servo reports."""

    servo: ServoStatus = dc.field(default_factory=ServoStatus)


def servo_command(mode: Mode, memory: PlannerMemory) -> ServoCommand:
    """Return what the servo must do in a mode."""
    if mode is Mode.GRASP and memory.trouble.failure is not None:
        return ServoCommand.HOLD  # the way out begins where the hand rests
    if mode is Mode.LIFT and memory.attempt.looked:
        return ServoCommand.PASS
    return COMMANDS.get(mode, ServoCommand.PASS)


class Servoed(TaskMode):
    """A mode in which the servo moves the arm, and the planner's motion follows it."""

    def trajectory(self, memory: PlannerMemory) -> Trajectory | None:
        """Return None: the servo knows the way."""
        return None

    def update(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """Rest where the servo has taken the arm."""
        memory, q = super().update(memory, now), _servo(now).q
        if len(q):
            memory.motion = Motion(q)
        return memory


class ServoGrasp(Servoed, Grasp):
    """Lets the servo move the open hand around the object.

    Args:
        config: Times and limits.
        replanner: Plans from what is seen.
        repeat: How many cycles the task has.
        time_limit: Time after which the servo counts as failed [s].
    """

    mode = Mode.GRASP

    def __init__(
        self,
        config: PlannerConfig,
        replanner: Replanner,
        repeat: int,
        time_limit: float,
    ) -> None:
        super().__init__(config, replanner, repeat)
        self.time_limit = time_limit

    def update(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """Plan a way out once the servo has failed, and the hand is at rest."""
        memory, servo = super().update(memory, now), _servo(now)
        attempt = memory.attempt
        if attempt.escape is not None:
            return memory
        failed = servo.state is ServoState.FAILED
        late = now.time - attempt.ready_at > self.time_limit
        if memory.trouble.failure is None and (failed or late):
            seen = servo.fault not in (None, ServoFault.STUCK)
            why = servo.fault.value if servo.fault is not None and failed else _LATE
            failure = Failure.NOT_SEEN if seen else Failure.OUT_OF_REACH
            memory.trouble = Trouble(failure, f"visual servo: {why}")
        if memory.trouble.failure is not None and servo.at_rest:
            self.replanner.Escape(memory, now.time)
        return memory

    def observe_mode(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report that the hand has reached the object, or that there is a way out."""
        attempt = memory.attempt
        if attempt.escape is not None:
            return Observation(stuck=now.time >= attempt.ready_at)
        return Observation(arrived=_servo(now).state is ServoState.REACHED)


class ServoClose(Servoed, Close):
    """Closes the fingers on the object while the hand follows it."""

    mode = Mode.CLOSE


class ServoVerify(Servoed, Verify):
    """Makes sure that the fingers hold the object while the hand follows it."""

    mode = Mode.VERIFY


class ServoLift(Lift):
    """Lets the servo raise the hand a little, plans the rest from there, and lifts."""

    mode = Mode.LIFT

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Remember how the fingers hold the object, and brake."""
        memory = super().enter(memory, entry)
        memory.motion = Motion(_servo(entry).q)
        return memory

    def Look(self, memory: PlannerMemory, now: Now) -> None:
        """Plan once the hand is at rest; the motion begins when the plan is ready."""
        servo = _servo(now)
        memory.motion, attempt = Motion(servo.q), memory.attempt
        if servo.state not in _HELD or not servo.at_rest:
            return
        self.replanner.Carry(memory, now.time)
        attempt.looked = True
        if not attempt.trapped:
            memory.motion = memory.motion.followed_by(
                attempt.planned.motions[self.mode], attempt.ready_at, self.wait
            )

    def observe_mode(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report a plan that failed, and then what every lift reports."""
        if memory.attempt.trapped:
            return Observation(failure=memory.trouble.failure)
        if not memory.attempt.looked:
            return Observation()
        return super().observe_mode(memory, now)


def servo_modes(
    config: PlannerConfig, replanner: Replanner, repeat: int, *, time_limit: float
) -> dict[Mode, TaskMode]:
    """Return what the planner does in each mode.

    Args:
        config: Times and limits.
        replanner: Plans from what is seen.
        repeat: How many cycles the task has.
        time_limit: Time after which the servo counts as failed [s].
    """
    modes = task_modes(config, replanner, repeat)
    modes[Mode.GRASP] = ServoGrasp(config, replanner, repeat, time_limit)
    for kind in (ServoClose, ServoVerify, ServoLift):
        modes[kind.mode] = kind(config, replanner, repeat)
    return modes


_Senses: TypeAlias = state_machine.Moment[Senses]


def _servo(now: _Senses) -> ServoStatus:
    assert isinstance(now.senses, ServoSenses), "these modes need a servo"
    return now.senses.servo
