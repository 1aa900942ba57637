"""A policy that moves the hand step by step, in a cell, in place of a planner."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import Context

from drake_srg.envs.hand_env import checked
from drake_srg.envs.hand_task import SHAKE
from drake_srg.envs.movers import Mover
from drake_srg.envs.physics import CONTROL_PERIOD
from drake_srg.envs.pick import MAX_STEPS, STEP, pick_state
from drake_srg.envs.rewards import LIFTED
from drake_srg.envs.workspace import Workspace
from drake_srg.learning.cell_planner import (
    CellPlanner,
    Command,
    between,
    ticks_between,
)
from drake_srg.learning.episodes import Act
from drake_srg.simulation.bench import shake
from drake_srg.types import Mode, Shape, Vector

# The policy has done its part once the closed hand has risen by this [m].
_RISEN = LIFTED + 0.02


@dc.dataclass(frozen=True, eq=False)
class _PolicyAttempt:
    """How far an attempt is.

    Attributes:
        estimate: Where the object was seen, shape (4,).
        pose: Of the hand, as commanded, shape (4,).
        tick: Control periods since the object was seen.
        closure: As commanded.
        steps: Of the policy.
        lowest: Height at which the hand has been, at least [m].
        risen: Whether the closed hand has risen, so that it is shaken.
        shaken: Control periods since the shake began.
    """

    estimate: Vector
    pose: Vector
    tick: int = 0
    closure: float = 0.0
    steps: int = 0
    lowest: float = np.inf
    risen: bool = False
    shaken: int = 0


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

    Once `blobs` shows the object, the hand goes to where the environment's episodes
    begin. Then the policy sees `arm_state` (2N), `gripper_state` (8) and
    `contact_force` (4) of the station and where the object was seen at first, and moves
    hand and closure every control period. Once the closed hand has risen by 12 cm, it
    is shaken, whatever it holds: no sensor tells how high the object is, by which the
    environment decides. A policy that has not come so far in the time of an episode
    ends as FAILED. The other ports are those of `CellPlanner`.

    Args:
        act: The policy: a `Policy`, or a rule of `drake_srg.learning.rules`.
        mover: See `CellPlanner`, as for `home`, `name`, `shape` and `table`.
        home: Shape (N,).
        name: Of the object.
        shape: Of the object.
        table: Height of the table [m].
        workspace: Where the hand may go.
        touch: Whether the policy sees the forces; zeros otherwise.
    """

    def __init__(
        self,
        act: Act,
        mover: Mover,
        home: Sequence[float],
        name: str,
        shape: Shape,
        table: float,
        *,
        workspace: Workspace,
        touch: bool = True,
    ) -> None:
        super().__init__(mover, home, name, shape, table)
        self._act, self._workspace, self._touch = act, workspace, touch
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
        """See `CellPlanner`."""
        return _PolicyAttempt(estimate, self._workspace.start)

    def act(
        self, context: Context, attempt: _PolicyAttempt
    ) -> tuple[_PolicyAttempt, Command]:
        """See `CellPlanner`."""
        attempt = dc.replace(attempt, tick=attempt.tick + 1)
        far = ticks_between(self.start, self._workspace.start)
        if attempt.tick <= far:
            pose = between(self.start, self._workspace.start, attempt.tick, far)
            return attempt, Command(Mode.PRE_GRASP, pose)
        if attempt.risen:
            return self._shake(attempt)
        if attempt.steps < MAX_STEPS:
            return self._step(context, attempt)
        message = f"the closed hand has not risen after {MAX_STEPS} steps"
        return attempt, Command(Mode.FAILED, attempt.pose, attempt.closure, message)

    def _step(
        self, context: Context, attempt: _PolicyAttempt
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
            attempt.steps / MAX_STEPS,
        )
        action = np.clip(checked(self._act(observation)), -1.0, 1.0)
        pose = self._workspace.within(attempt.pose + STEP * action[:4])
        closure = 0.5 * (action[4] + 1.0)
        lowest = min(attempt.lowest, pose[2])
        closed = closure > 0.5
        attempt = dc.replace(
            attempt,
            pose=pose,
            closure=closure,
            steps=attempt.steps + 1,
            lowest=lowest,
            risen=bool(closed and pose[2] > lowest + _RISEN),
        )
        return attempt, Command(Mode.CLOSE if closed else Mode.GRASP, pose, closure)

    def _shake(self, attempt: _PolicyAttempt) -> tuple[_PolicyAttempt, Command]:
        """Shake the hand, and end."""
        acceleration, frequency, duration = SHAKE
        attempt = dc.replace(attempt, shaken=attempt.shaken + 1)
        time = attempt.shaken * CONTROL_PERIOD
        if time > duration:
            return attempt, Command(Mode.DONE, attempt.pose, attempt.closure)
        motion = shake(attempt.pose, acceleration, frequency, duration)
        return attempt, Command(Mode.VERIFY, motion(time), attempt.closure)
