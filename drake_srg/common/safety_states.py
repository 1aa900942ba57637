"""The states of a safety monitor, and the reasons for its stops."""

import enum

from drake_srg.types import Vector


class SafetyState(enum.Enum):
    """State of the safety monitor."""

    RUNNING = "running"  # the arm follows the commands
    BRAKING = "braking"  # the arm comes to rest along its path
    PROTECTIVE_STOP = "protective_stop"  # the arm rests until released
    EMERGENCY_STOP = "emergency_stop"  # the arm rests and has forgotten its path


class StopReason(enum.Enum):
    """Why the arm is stopped."""

    NONE = "none"
    # Conditions that must be over before a release.
    FOLLOWING_ERROR = "following_error"  # a joint is too far from its command
    MEASURED_SPEED = "measured_speed"  # a joint moves too fast
    MEASURED_NOT_FINITE = "measured_not_finite"  # a measurement is NaN or infinite
    EXTERNAL_TORQUE = "external_torque"  # too much torque from outside on a joint
    FORCE = "force"  # the tool presses too hard
    STALE = "stale"  # no message for too long
    EMERGENCY_STOP = "emergency_stop"  # somebody pressed the button
    # Faults of the commands; the arm no longer follows them.
    NOT_FINITE = "not_finite"  # NaN or infinite
    POSITION = "position"  # beyond a joint's limit, or unable to stop before it
    SPEED = "speed"  # too far from the previous command
    ACCELERATION = "acceleration"  # too sudden a change
    TOOL_SPEED = "tool_speed"
    WORKSPACE = "workspace"  # the tool would leave its box
    LAG = "lag"  # too far ahead of a slowed arm, or on a path that the arm has left


STATES, REASONS = list(SafetyState), list(StopReason)


def state_indices(state: SafetyState, reason: StopReason) -> list[float]:
    """Return the indices of a state and a reason, as in the port `state`."""
    return [float(STATES.index(state)), float(REASONS.index(reason))]


def safety_state(indices: Vector) -> tuple[SafetyState, StopReason]:
    """Return the state and the reason of a value of the port `state`, shape (2,)."""
    return STATES[int(indices[0])], REASONS[int(indices[1])]


def describe_safety(indices: Vector) -> str:
    """Return a value of the port `state` as text: the state, and any reason."""
    state, reason = safety_state(indices)
    return ": ".join(x.value for x in (state, reason) if x is not StopReason.NONE)
