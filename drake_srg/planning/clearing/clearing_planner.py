"""The state machine that clears a table into a bin, as a system."""

from __future__ import annotations

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context

from drake_srg.planning.clearing.clearing_memory import ClearingMemory
from drake_srg.planning.clearing.clearing_mode import Senses
from drake_srg.planning.clearing.clearing_modes import clearing_modes
from drake_srg.planning.clearing.picking import PickPlanner
from drake_srg.planning.clearing.transitions import transition
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.planner_machine import PlannerMachine
from drake_srg.types import HeightMap

_NO_MAP = HeightMap(np.zeros(2), 1.0, np.zeros((0, 0)))


class ClearingPlanner(PlannerMachine[ClearingMemory, Senses]):
    """Takes one thing after the other from a table and drops it into a bin.

    .. pydrake_system::

        name: ClearingPlanner
        input_ports:
        - height_map
        - destination_map (optional)
        - arm_state
        - gripper_state
        - grasped
        - proximity
        output_ports:
        - position_commanded
        - closure_commanded
        - mode
        - status

    Inputs: `height_map` and `destination_map` (HeightMap each), of the table and of
    where loads go, evaluated only when the planner looks; `arm_state` (2N) and
    `gripper_state` (2n), [q; v] in rad and rad/s; `grasped` (1), nonzero once both
    fingers sense something; `proximity` (m), signed distances [m].

    Outputs: `position_commanded` (N) [rad]; `closure_commanded` (1), 0 open .. 1
    closed; `mode` (Mode); `status` (PlannerStatus).

    The planner knows no shapes. It looks from over the bin, where the arm hides
    nothing, takes the best grasp that the arm reaches, and carries whatever the fingers
    have closed on over the bin. A pick counts as held if the fingers feel something
    there (touch, proximity and their angles), and if what was at the grasp is gone
    from the table. Grasps that failed are avoided. At `config.max_attempts` failures in
    one place, the thing there is left.

    A load counts as cleared once it is seen where it was let go. The planner looks for
    it when the arm is at the next grasp and, after the last one, aside. What it does
    not see there is among `status.left`. Without `destination_map`, to have held a load
    is enough.

    DONE means that nothing is left on the table, or that `status.left` says what is,
    and why.

    `planner` can be read from the system.

    Args:
        planner: Plans the picks.
        num_fingers: Number n of the gripper's measured joints.
        num_sensors: Number m of its proximity readings.
    """

    def __init__(
        self, planner: PickPlanner, num_fingers: int, num_sensors: int
    ) -> None:
        q_home = planner.motions.q_home
        super().__init__(
            clearing_modes(planner),
            memory=ClearingMemory(Motion(q_rest=q_home)),
            transition=transition,
            config=planner.config,
        )
        self.planner = planner
        self._map = self.DeclareAbstractInputPort(
            name="height_map", model_value=AbstractValue.Make(_NO_MAP)
        )
        self._destinations = self.DeclareAbstractInputPort(
            name="destination_map", model_value=AbstractValue.Make(_NO_MAP)
        )
        self.DeclareHandInputs(num_fingers, num_sensors)

    def sense(self, context: Context) -> Senses:
        """Return the measurements; the cameras are asked only when a mode looks."""
        return Senses(
            **vars(self.hand_senses(context, lambda: self._map.Eval(context))),
            see_destinations=lambda: (
                self._destinations.Eval(context)
                if self._destinations.HasValue(context)
                else None
            ),
        )
