"""A one-shot grasp in a cell, in place of a planner: look, come down, close, lift."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

from pydrake.systems.framework import Context

from drake_srg.envs.grasp_one_shot import (
    CLOSE,
    DOWN,
    UP,
    Grasp,
    grasp_of,
    one_shot_state,
)
from drake_srg.envs.hand_env import checked
from drake_srg.envs.hand_task import SHAKE
from drake_srg.envs.movers import Mover
from drake_srg.envs.physics import CONTROL_PERIOD
from drake_srg.learning.cell_planner import (
    CellPlanner,
    Command,
    between,
    ticks_between,
)
from drake_srg.learning.episodes import Act
from drake_srg.simulation.bench import shake
from drake_srg.types import Mode, Shape, Vector


@dc.dataclass(frozen=True, eq=False)
class _GraspAttempt:
    """A grasp, and the control periods since the object was seen."""

    grasp: Grasp
    tick: int = 0


class GraspPlanner(CellPlanner):
    """Grasps, lifts and shakes an object by a policy of `GraspOneShot`.

    .. pydrake_system::

        name: GraspPlanner
        input_ports:
        - blobs
        output_ports:
        - position_commanded
        - closure_commanded
        - mode
        - status

    The policy sees the object's size and acts once, when `blobs` shows the object for
    the first time. From then on everything is as in the environment: the hand comes
    down from above, closes, lifts and shakes. The ports are those of `CellPlanner`.

    Args:
        act: The policy: a `Policy`, or a rule of `drake_srg.learning.rules`.
        mover: See `CellPlanner`, as for all that follow.
        home: Shape (N,).
        name: Of the object.
        shape: Of the object.
        table: Height of the table [m].
    """

    def __init__(
        self,
        act: Act,
        mover: Mover,
        home: Sequence[float],
        name: str,
        shape: Shape,
        table: float,
    ) -> None:
        super().__init__(mover, home, name, shape, table)
        self._act = act

    def begin(self, estimate: Vector) -> _GraspAttempt:
        """See `CellPlanner`."""
        action = checked(self._act(one_shot_state(self.shape)))
        return _GraspAttempt(grasp_of(action, estimate, self.table))

    def act(
        self, context: Context, attempt: _GraspAttempt
    ) -> tuple[_GraspAttempt, Command]:
        """See `CellPlanner`."""
        del context
        command = self._command(attempt.grasp, attempt.tick)
        return dc.replace(attempt, tick=attempt.tick + 1), command

    def _command(self, grasp: Grasp, tick: int) -> Command:
        """Return what the hand does so many control periods after the look."""
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
        acceleration, frequency, duration = SHAKE
        time = tick * CONTROL_PERIOD
        if time > duration:
            return Command(Mode.DONE, grasp.up, grasp.closure)
        motion = shake(grasp.up, acceleration, frequency, duration)
        return Command(Mode.VERIFY, motion(time), grasp.closure)
