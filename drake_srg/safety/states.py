"""How the states of the safety monitor follow one another."""

import dataclasses as dc
from collections.abc import Callable

from drake_srg.common.safety_states import SafetyState, StopReason


@dc.dataclass(frozen=True)
class Observation:
    """The facts that decide the next state."""

    reason: StopReason = StopReason.NONE  # the first reason to stop, if any holds now
    braked_for: StopReason = StopReason.NONE  # why the arm is being stopped
    standstill: bool = False  # the commanded arm is at rest
    released: bool = False  # somebody has just acknowledged the stop

    @property
    def emergency(self) -> bool:
        """Whether the button is pressed."""
        return self.reason is StopReason.EMERGENCY_STOP

    @property
    def may_run(self) -> bool:
        """Whether the stop is acknowledged and its cause over."""
        return self.released and self.reason is StopReason.NONE


# state: [(condition; next state)]. The first condition that holds decides.
TRANSITIONS: dict[
    SafetyState, list[tuple[Callable[[Observation], bool], SafetyState]]
] = {
    SafetyState.RUNNING: [
        (lambda o: o.reason is not StopReason.NONE, SafetyState.BRAKING),
    ],
    SafetyState.BRAKING: [
        (
            lambda o: o.standstill and o.braked_for is StopReason.EMERGENCY_STOP,
            SafetyState.EMERGENCY_STOP,
        ),
        (lambda o: o.standstill, SafetyState.PROTECTIVE_STOP),
    ],
    SafetyState.PROTECTIVE_STOP: [
        (lambda o: o.emergency, SafetyState.EMERGENCY_STOP),
        (lambda o: o.may_run, SafetyState.RUNNING),
    ],
    SafetyState.EMERGENCY_STOP: [
        (lambda o: o.may_run, SafetyState.RUNNING),
    ],
}


def transition(state: SafetyState, observation: Observation) -> SafetyState:
    """Return the state that follows, by the table `TRANSITIONS`."""
    for condition, following in TRANSITIONS[state]:
        if condition(observation):
            return following
    return state
