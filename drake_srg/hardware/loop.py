"""The control loop of a run on hardware."""

from __future__ import annotations

import dataclasses as dc
import math

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from drake_srg.bridges.commands import PortValues
from drake_srg.common.safety_states import SafetyState, StopReason, safety_state
from drake_srg.lifetime import my_context
from drake_srg.scenario import Scenario
from drake_srg.simulation.run_log import RunLog
from drake_srg.simulation.simulate import failure_time
from drake_srg.types import Failure, Mode, PlannerStatus

# A run goes on for this time after its end is known, so that the last commands arrive
# and are recorded [s].
_SETTLE = 0.5
_STOPPED = (SafetyState.PROTECTIVE_STOP, SafetyState.EMERGENCY_STOP)
_WHY = {
    StopReason.STALE: "nothing arrives from the robot any more",
    StopReason.FOLLOWING_ERROR: "the joints are not where they were sent",
    StopReason.MEASURED_SPEED: "a joint moves too fast",
    StopReason.EMERGENCY_STOP: "stopped by the user",
}


class ControlLoop:
    """Advances a cell one control period at a time, until the run has ended.

    Only `advance` touches the context, so all of it happens in one thread. It never
    waits for the robot or the planner.

    A stop ends the run, unless the arm may wait for a release. Then the run goes on
    once the stop is acknowledged and its cause over.

    Args:
        name: The scenario's.
        scenario: That runs on the hardware.
        diagram: The root, with the cell in it.
        cell: Of `MakeHardwareCell`.
        release: How long a stopped arm waits for a release [s].

    Attributes:
        log: Of the run so far.
        status: The planner's last report, or that the arm was stopped.
        period: Of the loop [s].
    """

    def __init__(
        self,
        name: str,
        scenario: Scenario,
        diagram: Diagram,
        cell: Diagram,
        release: float = 0.0,
    ) -> None:
        assert scenario.arm is not None
        self.period = scenario.arm.period
        self.log = RunLog(scenario, cell)
        self.status = PlannerStatus()
        self._name, self._cell, self._simulator = name, cell, Simulator(diagram)
        self._root = self._simulator.get_mutable_context()
        self._context = my_context(cell, self._root)
        self._safety = cell.GetOutputPort("safety.state")
        self._status = cell.GetOutputPort("planner.status")
        self._sampling, self._next_sample = scenario.recording.period, 0.0
        self._steps, self._release = 0, release
        self._resting_since = math.inf  # in a stop
        self._ends = False  # whether a stop ends the run all the same
        self._end: float | None = None  # when the run ends, once that is known
        with failure_time(name, self._simulator):
            self._simulator.Initialize()

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return float(self._root.get_time())

    @property
    def safety(self) -> tuple[SafetyState, StopReason]:
        """What the safety monitor does, and why."""
        return safety_state(self._safety.Eval(self._context))

    @property
    def waits(self) -> str:
        """What a resting arm's stop was for, while it waits for a release, or ""."""
        state, reason = self.safety
        return reason.value if state in _STOPPED and self._end is None else ""

    def press_estop(self) -> None:
        """Stop the arm; the run ends once it rests."""
        self._ends = True

    def _fix(self, values: PortValues) -> None:
        for name, value in values.items():
            self._cell.GetInputPort(name).FixValue(self._context, value)

    def advance(self, commands: PortValues | None = None) -> bool:
        """Advance by one period; return whether the run goes on.

        Args:
            commands: To the safety monitor, by input port of the cell. A release counts
                for this period.

        Raises:
            ScenarioError: If Drake fails.
        """
        self._steps += 1
        commands = {"safety.release": np.zeros(1), **(commands or {})}
        if self._ends:
            commands["safety.estop"] = np.ones(1)
        with failure_time(self._name, self._simulator):
            # Between two updates: at an update's own time, a command has already been
            # sent that the monitor would then contradict.
            self._simulator.AdvanceTo((self._steps - 0.5) * self.period)
            self._fix(commands)
            self._simulator.AdvanceTo(self._steps * self.period)
        if self.time >= self._next_sample - 1e-9:
            self._next_sample += self._sampling
            self.log.sample(self._context)
        self.status = self._status.Eval(self._context)
        state, reason = self.safety
        resting = state in _STOPPED
        self._resting_since = (
            min(self._resting_since, self.time) if resting else math.inf
        )
        waited = self.time - self._resting_since
        if resting and (self._ends or waited >= self._release):
            why = _WHY.get(reason, "a limit was reached")
            self.status = dc.replace(
                self.status,
                mode=Mode.FAILED,
                failure=Failure.STOPPED,
                message=f"the arm was stopped ({reason.value}): {why}",
            )
        if self._end is None and self.status.mode in (Mode.DONE, Mode.FAILED):
            self._end = self.time + _SETTLE
        return self._end is None or self.time < self._end
