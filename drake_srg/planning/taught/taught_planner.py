"""The state machine of the five-axis arm's thesis, as a system."""

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context

from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.planner_machine import PlannerConfig, PlannerMachine
from drake_srg.planning.taught.taught_modes import (
    KINDS,
    Senses,
    TaughtMemory,
    transition,
)
from drake_srg.planning.taught.taught_motions import TaughtMotions


class TaughtPlanner(PlannerMachine[TaughtMemory, Senses]):
    """Looks once and moves through taught waypoints, as the arm's thesis does.

    .. pydrake_system::

        name: TaughtPlanner
        input_ports:
        - blobs
        - arm_state
        - grasped
        output_ports:
        - position_commanded
        - closure_commanded
        - mode
        - status

    Inputs: `blobs` (list[Blob]), evaluated until it has an object of the name;
    `arm_state` (2N), [q; v] in rad and rad/s; `grasped` (1), nonzero once both fingers
    sense something. Outputs: `position_commanded` (N) [rad]; `closure_commanded` (1), 0
    open .. 1 closed; `mode` (Mode); `status` (PlannerStatus).

    The blob's position is the grasp point P2. The tip goes from P0 (home) to P1 beside
    it, to P2, up to the taught P3, down to the taught P4 and home, on straight lines
    where the arm can keep to them. The hand closes until both fingers have sensed
    something for `config.grip_wait`, and opens at P4 for `config.release_wait`. There
    is no second look, no correction and no check of the grasp: DONE means that the arm
    is home.

    Args:
        motions: Plans the motions.
        object_name: Name of the blob to take.
        config: Waits, latency, the times to search and to give up, and the period.
    """

    def __init__(
        self, motions: TaughtMotions, object_name: str, config: PlannerConfig
    ) -> None:
        super().__init__(
            {kind.mode: kind(motions, config, object_name) for kind in KINDS},
            memory=TaughtMemory(Motion(q_rest=motions.q_home)),
            transition=transition,
            config=config,
        )
        self.config = config
        self._blobs = self.DeclareAbstractInputPort(
            name="blobs", model_value=AbstractValue.Make([])
        )
        self._n = len(motions.q_home)
        self._arm = self.DeclareVectorInputPort(name="arm_state", size=2 * self._n)
        self._grasped = self.DeclareVectorInputPort(name="grasped", size=1)

    def sense(self, context: Context) -> Senses:
        """Return the measurements; the camera is asked only while the planner looks."""
        return Senses(
            q=self._arm.Eval(context)[: self._n],
            gripped=bool(self._grasped.Eval(context)[0]),
            see=lambda: self._blobs.Eval(context),
        )
