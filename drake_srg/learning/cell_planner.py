"""Policies as planners of a cell: a one-shot grasp, or motions step by step."""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RollPitchYaw
from pydrake.systems.framework import BasicVector, Context, EventStatus, State

from drake_srg.common.geometry import minimum_jerk_blend
from drake_srg.learning.envs.hand_env import checked
from drake_srg.learning.envs.hand_task import Mover, shaken
from drake_srg.learning.envs.rewards import LIFTED
from drake_srg.learning.envs.scenes import CONTROL_PERIOD, Workspace
from drake_srg.learning.envs.tasks import (
    CLOSE,
    DOWN,
    MAX_STEPS,
    STEP,
    UP,
    Grasp,
    grasp_of,
    one_shot_state,
    pick_state,
)
from drake_srg.learning.episodes import Act
from drake_srg.lifetime import LeafSystem
from drake_srg.planning.planner_machine import AddCommandOutputs, AddStatusOutput
from drake_srg.types import Blob, Cylinder, Failure, Mode, PlannerStatus, Shape, Vector

# Longest wait for the localizer to find the object [s].
_PATIENCE = 1.0
# Greatest mean speed of the hand [m/s, rad/s]. A minimum-jerk motion peaks at 1.9 times
# its mean speed, and this peak is within the environments' limit.
_SPEED = np.array([0.2, 0.2, 0.2, 1.0])
_UPRIGHT = np.cos(np.deg2rad(15.0))  # largest lean of a localizer's boxes


@dc.dataclass(frozen=True, eq=False)
class Command:
    """Command to the hand until the next control period.

    Attributes:
        mode: The reported mode; DONE and FAILED end the attempt.
        pose: Pose of the hand, [x, y, z, yaw], shape (4,) [m, rad].
        closure: 0 open .. 1 closed.
        message: The reason of a failure.
    """

    mode: Mode
    pose: Vector
    closure: float = 0.0
    message: str = ""


@dc.dataclass(frozen=True, eq=False)
class _Memory:
    """State of the planner between updates.

    Attributes:
        q: Commanded positions of the arm's joints, shape (N,).
        before: Commanded positions of the previous period.
        ticks: Control periods since the start.
        closure: Commanded closure.
        attempt: The subclass's memory; None before the object was found.
        status: Reported status.
    """

    q: Vector
    before: Vector
    ticks: int = 0
    closure: float = 0.0
    attempt: Any = None
    status: PlannerStatus = dc.field(default_factory=PlannerStatus)


class CellPlanner(LeafSystem):
    """Base class of planners that act by a policy once they have seen the object.

    The input `blobs` (list[Blob]) must show the object while the arm is at home. The
    output `position_commanded` (N) moves linearly from one control period's value to
    the next.
    `closure_commanded` (1) is 0 .. 1. `mode` (Mode) and `status` (PlannerStatus) end as
    DONE, even if the hand holds nothing, or as FAILED: `not_seen` if no blob shows the
    object upright, `time_budget` if the policy has not finished.

    Args:
        policy: A `Policy`, or a rule of `drake_srg.learning.rules`.
        mover: Mover of the arm; see `drake_srg.learning.envs.hand_task.MakeMover`.
        home: Positions of the arm's joints at the start, shape (N,).
        name: Name of the object.
        shape: Shape of the object, about the origin of its frame.
        table: Height of the table [m].
    """

    def __init__(
        self,
        policy: Act,
        mover: Mover,
        home: Sequence[float],
        name: str,
        shape: Shape,
        table: float,
    ) -> None:
        super().__init__()
        self.policy, self.mover = policy, mover
        self.name, self.shape, self.table = name, shape, table
        q = np.array(home, float)
        self.start = mover.pose(q)
        self._blobs = self.DeclareAbstractInputPort(
            "blobs", AbstractValue.Make(list[Blob]())
        )
        index = self.DeclareAbstractState(AbstractValue.Make(_Memory(q, q)))
        self.DeclarePeriodicUnrestrictedUpdateEvent(CONTROL_PERIOD, 0.0, self._update)
        tickets = {self.abstract_state_ticket(index)}
        AddCommandOutputs(
            self,
            len(q),
            position=self._calc_position,
            closure=self._calc_closure,
            prerequisites=tickets,
        )
        AddStatusOutput(self, self._calc_status, tickets)
        self.DeclareAbstractOutputPort(
            name="mode",
            alloc=lambda: AbstractValue.Make(Mode.IDLE),
            calc=self._calc_mode,
            prerequisites_of_calc=tickets,
        )

    def begin(self, estimate: Vector) -> Any:
        """Return the memory of an attempt at an object.

        Args:
            estimate: Pose of the object's centre where it was seen, [x, y, z, yaw] in
                world, shape (4,) [m, rad].
        """
        raise NotImplementedError

    def act(self, context: Context, attempt: Any) -> tuple[Any, Command]:
        """Return the attempt after one control period, and the command until then.

        A command that ends the attempt is the last: `act` is not called again.
        """
        raise NotImplementedError

    def _memory(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(0).get_value()
        return memory

    def _calc_position(self, context: Context, output: BasicVector) -> None:
        memory = self._memory(context)
        share = context.get_time() / CONTROL_PERIOD - (memory.ticks - 1)
        share = min(max(share, 0.0), 1.0)
        output.SetFromVector(memory.before + share * (memory.q - memory.before))

    def _calc_closure(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([self._memory(context).closure])

    def _calc_status(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._memory(context).status)

    def _calc_mode(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._memory(context).status.mode)

    def _update(self, context: Context, state: State) -> EventStatus:
        memory = self._memory(context)
        memory = dc.replace(memory, ticks=memory.ticks + 1, before=memory.q)
        ended = memory.status.ended
        if memory.attempt is None and not ended:
            memory = self._look(context, memory)
        if memory.attempt is not None and not ended:
            attempt, command = self.act(context, memory.attempt)
            failed = Failure.TIME_BUDGET if command.mode is Mode.FAILED else None
            status = dc.replace(
                memory.status,
                mode=command.mode,
                failure=failed,
                message=command.message,
            )
            memory = dc.replace(
                memory,
                q=self.mover.follow(memory.q, command.pose),
                closure=command.closure,
                attempt=attempt,
                status=status,
            )
        state.get_mutable_abstract_state(0).set_value(memory)
        return EventStatus.Succeeded()

    def _look(self, context: Context, memory: _Memory) -> _Memory:
        """Begin an attempt at a visible object, or give up."""
        time = context.get_time()
        seen = tuple(self._blobs.Eval(context))
        blobs = [b for b in seen if b.object_name == self.name]
        blob = max(blobs, key=lambda b: (b.certain, b.trust), default=None)
        status = dc.replace(memory.status, looks=memory.status.looks + 1, blobs=seen)
        if blob is None or blob.axis[2] < _UPRIGHT:
            if time >= _PATIENCE:
                what = "does not stand" if blob else "is not seen"
                status = dc.replace(
                    status,
                    mode=Mode.FAILED,
                    failure=Failure.NOT_SEEN,
                    message=f"{self.name} {what}",
                )
            return dc.replace(memory, status=status)
        yaw = RollPitchYaw(blob.X_WO.rotation()).yaw_angle()
        round_ = isinstance(self.shape, Cylinder)
        return dc.replace(
            memory,
            attempt=self.begin(np.append(blob.position, 0.0 if round_ else yaw)),
            status=dc.replace(status, attempts=1, localization=blob, localized_at=time),
        )


def ticks_between(start: Vector, end: Vector) -> int:
    """Return the number of control periods of a motion between two poses (4)."""
    return math.ceil(np.max(np.abs(end - start) / _SPEED) / CONTROL_PERIOD)


def between(start: Vector, end: Vector, tick: int, ticks: int) -> Vector:
    """Return the pose (4) after `tick` of a motion's `ticks` control periods."""
    pose: Vector = start + minimum_jerk_blend(tick / max(ticks, 1)) * (end - start)
    return pose


def shake_or_end(pose: Vector, ticks: int, closure: float) -> Command:
    """Return the command `ticks` control periods after the shake about a pose began."""
    moved = shaken(pose, ticks * CONTROL_PERIOD)
    if moved is None:
        return Command(Mode.DONE, pose, closure)
    return Command(Mode.VERIFY, moved, closure)


@dc.dataclass(frozen=True, eq=False)
class _GraspAttempt:
    """A grasp, and the number of control periods since the object was seen."""

    grasp: Grasp
    tick: int = 0


class OneShotPlanner(CellPlanner):
    """Grasps, lifts and shakes an object by a policy of `GraspOneShot`.

    .. pydrake_system::

        name: OneShotPlanner
        input_ports:
        - blobs
        output_ports:
        - position_commanded
        - closure_commanded
        - mode
        - status

    The policy sees the object's size and acts once, when `blobs` shows the object for
    the first time. Then the hand moves as in the environment: it comes down, closes,
    lifts and shakes. Ports and arguments are those of `CellPlanner`.
    """

    def begin(self, estimate: Vector) -> _GraspAttempt:
        """Return the memory of an attempt at an object."""
        action = checked(self.policy(one_shot_state(self.shape)))
        return _GraspAttempt(grasp_of(action, estimate, self.table))

    def act(
        self, context: Context, attempt: _GraspAttempt
    ) -> tuple[_GraspAttempt, Command]:
        """Return the attempt after one control period, and the command until then."""
        del context
        command = self._command(attempt.grasp, attempt.tick)
        return dc.replace(attempt, tick=attempt.tick + 1), command

    def _command(self, grasp: Grasp, tick: int) -> Command:
        """Return the hand's command a number of control periods after the look."""
        legs = (
            (Mode.PRE_GRASP, ticks_between(self.start, grasp.over), grasp.over, 0.0),
            (Mode.GRASP, DOWN, grasp.at, grasp.preshape),
            (Mode.CLOSE, CLOSE, grasp.at, grasp.closure),
            (Mode.LIFT, UP, grasp.up, grasp.closure),
        )
        pose = self.start
        for mode, ticks, end, closure in legs:
            if tick <= ticks:
                return Command(mode, between(pose, end, tick, ticks), closure)
            tick, pose = tick - ticks, end
        return shake_or_end(grasp.up, tick, grasp.closure)


# The policy's part ends once the closed hand has risen by this [m].
_RISEN = LIFTED + 0.02


@dc.dataclass(frozen=True, eq=False)
class _PolicyAttempt:
    """Progress of an attempt.

    Attributes:
        estimate: The object's seen pose, shape (4,).
        pose: Pose of the hand, as commanded, shape (4,).
        tick: Control periods since the object was seen.
        closure: Commanded closure.
        lowest: Least height of the hand so far [m].
        risen: The tick at which the closed hand had risen and the shake began, or None.
    """

    estimate: Vector
    pose: Vector
    tick: int = 0
    closure: float = 0.0
    lowest: float = np.inf
    risen: int | None = None


class PolicyPlanner(CellPlanner):
    """Picks up and shakes an object by a policy of `Pick`.

    .. pydrake_system::

        name: PolicyPlanner
        input_ports:
        - blobs
        - arm_state
        - gripper_state
        - contact_force
        output_ports:
        - position_commanded
        - closure_commanded
        - mode
        - status

    Once `blobs` shows the object, the hand goes to the start of the environment's
    episodes. Then the policy sees the object's first pose and the station's `arm_state`
    (2N), `gripper_state` (8) and `contact_force` (4). It moves hand and closure every
    control period. Once the closed hand has risen by 12 cm, it shakes, even if empty.
    (The environment decides by the object's height, for which a cell has no sensor.) A
    policy that does not rise within the time of an episode ends as FAILED. The other
    ports and arguments are those of `CellPlanner`. The hand stays in `workspace`.
    Without `touch`, the policy sees zeros as forces.
    """

    def __init__(
        self,
        policy: Act,
        mover: Mover,
        home: Sequence[float],
        name: str,
        shape: Shape,
        table: float,
        *,
        workspace: Workspace,
        touch: bool = True,
    ) -> None:
        super().__init__(policy, mover, home, name, shape, table)
        self._workspace, self._touch = workspace, touch
        self._n = len(home)
        self._sensors = {
            port: self.DeclareVectorInputPort(port, size)
            for port, size in (
                ("arm_state", 2 * self._n),
                ("gripper_state", 8),
                ("contact_force", 4),
            )
        }

    def begin(self, estimate: Vector) -> _PolicyAttempt:
        """Return the memory of an attempt at an object."""
        return _PolicyAttempt(estimate, self._workspace.start)

    def act(
        self, context: Context, attempt: _PolicyAttempt
    ) -> tuple[_PolicyAttempt, Command]:
        """Return the attempt after one control period, and the command until then."""
        attempt = dc.replace(attempt, tick=attempt.tick + 1)
        start = self._workspace.start
        far = ticks_between(self.start, start)
        if attempt.tick <= far:
            pose = between(self.start, start, attempt.tick, far)
            return attempt, Command(Mode.PRE_GRASP, pose)
        if attempt.risen is not None:
            ticks = attempt.tick - attempt.risen
            return attempt, shake_or_end(attempt.pose, ticks, attempt.closure)
        steps = attempt.tick - far - 1  # of the policy so far
        if steps < MAX_STEPS:
            return self._step(context, attempt, steps)
        message = f"the closed hand has not risen after {MAX_STEPS} steps"
        return attempt, Command(Mode.FAILED, attempt.pose, attempt.closure, message)

    def _step(
        self, context: Context, attempt: _PolicyAttempt, steps: int
    ) -> tuple[_PolicyAttempt, Command]:
        """Let the policy act."""
        sensed = {name: port.Eval(context) for name, port in self._sensors.items()}
        observation = pick_state(
            self.mover.pose(sensed["arm_state"][: self._n]),
            attempt.estimate,
            self.shape,
            self.table,
            sensed["gripper_state"],
            sensed["contact_force"] if self._touch else np.zeros(4),
            attempt.closure,
            steps / MAX_STEPS,
        )
        action = np.clip(checked(self.policy(observation)), -1.0, 1.0)
        pose = self._workspace.within(attempt.pose + STEP * action[:4])
        closure = 0.5 * (action[4] + 1.0)
        lowest = min(attempt.lowest, pose[2])
        closed = closure > 0.5
        attempt = dc.replace(
            attempt,
            pose=pose,
            closure=closure,
            lowest=lowest,
            risen=attempt.tick if closed and pose[2] > lowest + _RISEN else None,
        )
        return attempt, Command(Mode.CLOSE if closed else Mode.GRASP, pose, closure)
