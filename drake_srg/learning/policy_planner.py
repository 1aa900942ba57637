"""A policy in a cell, in place of a planner."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, DiscreteValues

from drake_srg.envs.hand_task import LOWEST
from drake_srg.envs.movers import Mover
from drake_srg.envs.physics import CONTROL_PERIOD
from drake_srg.envs.pick import MAX_STEPS, STEP, pick_state
from drake_srg.envs.rewards import LIFTED
from drake_srg.learning.episodes import Act
from drake_srg.lifetime import LeafSystem
from drake_srg.planning.planner_outputs import AddPlannerOutputs
from drake_srg.types import Mode, PlannerStatus, Shape, Vector

# The policy has done its part once the closed hand has risen by this [m].
_RISEN = LIFTED + 0.02


class PolicyPlanner(LeafSystem):
    """Picks up an object by a policy of the environment `Pick`.

    .. pydrake_system::

        name: PolicyPlanner
        input_ports:
        - estimate
        - arm_state
        - gripper_state
        - contact_force
        output_ports:
        - position_commanded
        - closure_commanded
        - mode
        - status

    `estimate` (4) is where the object is thought to be, [x, y, z, yaw] of its centre in
    world [m, rad]. `arm_state` (2N), `gripper_state` (8) and `contact_force` (4) come
    from the station. Every control period of the environments, the policy moves
    `position_commanded` (N) and sets `closure_commanded` (1). Once the closed hand has
    risen, it stays, and `mode` (Mode) is DONE. `status` (PlannerStatus) contains only
    the mode: a policy does not say whether it holds anything.

    Args:
        act: The policy: a `Policy`, or a rule of `drake_srg.learning.rules`.
        mover: Of the arm; see `drake_srg.envs.movers.MakeMover`.
        home: Positions of the arm's joints at the start, shape (N,).
        shape: Of the object.
        table: Height of the table [m].
    """

    def __init__(
        self, act: Act, mover: Mover, home: Sequence[float], shape: Shape, table: float
    ) -> None:
        super().__init__()
        self._act, self._mover, self._shape = act, mover, shape
        self._table, self._n = table, len(home)
        self._inputs = {
            name: self.DeclareVectorInputPort(name, size)
            for name, size in (
                ("estimate", 4),
                ("arm_state", 2 * self._n),
                ("gripper_state", 8),
                ("contact_force", 4),
            )
        }
        q = np.array(home, float)
        # Commanded joints and pose; closure, periods, lowest height, whether done.
        start = [*q, *mover.pose(q), 0.0, 0.0, np.inf, 0.0]
        state = self.DeclareDiscreteState(np.array(start))
        self.DeclarePeriodicDiscreteUpdateEvent(CONTROL_PERIOD, 0.0, self._update)
        tickets = {self.discrete_state_ticket(state)}
        AddPlannerOutputs(
            self,
            self._n,
            position=lambda c, out: out.SetFromVector(self._state(c)[: self._n]),
            closure=lambda c, out: out.SetFromVector([self._state(c)[self._n + 4]]),
            status=self._calc_status,
            prerequisites=tickets,
        )
        self.DeclareAbstractOutputPort(
            name="mode",
            alloc=lambda: AbstractValue.Make(Mode.IDLE),
            calc=lambda c, out: out.set_value(self._mode(c)),
            prerequisites_of_calc=tickets,
        )

    def _state(self, context: Context) -> Vector:
        state: Vector = context.get_discrete_state_vector().value()
        return state

    def _mode(self, context: Context) -> Mode:
        closure, _, _, done = self._state(context)[self._n + 4 :]
        if done:
            return Mode.DONE
        return Mode.CLOSE if closure > 0.5 else Mode.GRASP

    def _calc_status(self, context: Context, output: AbstractValue) -> None:
        output.set_value(PlannerStatus(mode=self._mode(context)))

    def _update(self, context: Context, values: DiscreteValues) -> None:
        """Let the policy act."""
        n = self._n
        state = self._state(context).copy()
        q, pose, (closure, steps, lowest, done) = np.split(state, [n, n + 4])
        if done:
            return
        sensed = {name: port.Eval(context) for name, port in self._inputs.items()}
        observation = pick_state(
            self._mover.pose(sensed["arm_state"][:n]),
            sensed["estimate"],
            self._shape,
            self._table,
            sensed["gripper_state"],
            sensed["contact_force"],
            closure,
            steps / MAX_STEPS,
        )
        action = np.clip(np.asarray(self._act(observation), float), -1.0, 1.0)
        pose = pose + STEP * action[:4]
        pose[2] = max(pose[2], self._table + LOWEST)
        closure = 0.5 * (action[4] + 1.0)
        lowest = min(lowest, pose[2])
        done = float(closure > 0.5 and pose[2] > lowest + _RISEN)
        q = self._mover.follow(q, pose)
        state = np.concatenate([q, pose, [closure, steps + 1.0, lowest, done]])
        values.set_value(state)
