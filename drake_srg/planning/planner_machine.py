"""The state machine of planners that move an arm by planned motions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Generic, Protocol, TypeVar

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context

from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.planner_outputs import AddPlannerOutputs
from drake_srg.planning.state_machine import (
    ModeActions,
    ObservationT,
    SensesT,
    StateMachine,
)
from drake_srg.planning.task.config import PlannerConfig
from drake_srg.types import Failure, Mode, PlannerStatus

# Why any planner gives up, in words.
GIVES_UP: Mapping[Failure, str] = {
    Failure.STOPPED: "the arm does not get where it is sent; something is in its way",
    Failure.TIME_BUDGET: "the time budget is used up",
}


class MotionMemory(Protocol):
    """A memory that says what a planner commands and reports."""

    @property
    def motion(self) -> Motion:
        """The arm's motion."""

    @property
    def closure(self) -> float:
        """The commanded closure, 0 open .. 1 closed."""

    def status(self, mode: Mode) -> PlannerStatus:
        """Return the planner's report on its task in a mode."""


MotionMemoryT = TypeVar("MotionMemoryT", bound=MotionMemory)


class PlannerMachine(
    StateMachine[Mode, MotionMemoryT, SensesT, ObservationT],
    Generic[MotionMemoryT, SensesT, ObservationT],
):
    """A planner whose outputs come from its memory; it begins in IDLE.

    Its outputs are `mode` and those of `AddPlannerOutputs`. Derive from it: declare the
    inputs after calling `__init__`, and override `sense`.

    Args:
        modes: What to do in each mode.
        memory: The memory that IDLE is entered with; its motion rests at home.
        transition: Returns the mode that follows from (mode, observation, time in the
            mode [s], config).
        config: Its period is the time between updates.
    """

    def __init__(
        self,
        modes: Mapping[Mode, ModeActions[Mode, MotionMemoryT, SensesT, ObservationT]],
        *,
        memory: MotionMemoryT,
        transition: Callable[[Mode, ObservationT, float, PlannerConfig], Mode],
        config: PlannerConfig,
    ) -> None:
        super().__init__(
            modes,
            initial=Mode.IDLE,
            memory=memory,
            transition=lambda mode, o, t: transition(mode, o, t, config),
            period=config.period,
        )
        AddPlannerOutputs(
            self,
            len(memory.motion.q_rest),
            position=self._calc_position,
            closure=self._calc_closure,
            status=self._calc_status,
            prerequisites={self.state_ticket},
        )

    def motion(self, context: Context) -> Motion:
        """Return the arm's motion under way, which `position_commanded` follows."""
        return self.state(context).memory.motion

    def _calc_position(self, context: Context, output: BasicVector) -> None:
        position = self.motion(context).position(context.get_time())
        output.SetFromVector(position)

    def _calc_closure(self, context: Context, output: BasicVector) -> None:
        output[0] = self.state(context).memory.closure

    def _calc_status(self, context: Context, output: AbstractValue) -> None:
        state = self.state(context)
        output.set_value(state.memory.status(state.mode))
