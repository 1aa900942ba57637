"""The states of the safety monitor, and how they follow one another."""

import dataclasses as dc
import enum
from collections.abc import Callable


class SafetyState(enum.Enum):
    """What the monitor does."""

    RUNNING = "running"  # the arm follows the commands
    BRAKING = "braking"  # it comes to rest along its path
    PROTECTIVE_STOP = "protective_stop"  # it rests until released
    EMERGENCY_STOP = "emergency_stop"  # it rests; its path is forgotten


class StopReason(enum.Enum):
    """Why the arm is stopped."""

    NONE = "none"
    # Conditions that must be over before a release.
    FOLLOWING_ERROR = "following_error"  # the joints are not where they should be
    MEASURED_SPEED = "measured_speed"  # a joint moves too fast
    MEASURED_NOT_FINITE = "measured_not_finite"  # a measurement is NaN or infinite
    EXTERNAL_TORQUE = "external_torque"  # a joint feels too much from outside
    FORCE = "force"  # the tool presses too hard
    STALE = "stale"  # no message for too long
    EMERGENCY_STOP = "emergency_stop"  # somebody pressed the button
    # Faults of the commands, which are no longer followed.
    NOT_FINITE = "not_finite"  # NaN or infinite
    POSITION = "position"  # beyond a joint's limit, or unable to stop before it
    SPEED = "speed"  # too far from the command before
    ACCELERATION = "acceleration"  # too sudden a change
    TOOL_SPEED = "tool_speed"
    WORKSPACE = "workspace"  # the tool would leave its box
    LAG = "lag"  # too far ahead of a slowed arm, or the arm has left their path


STATES, REASONS = list(SafetyState), list(StopReason)


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
