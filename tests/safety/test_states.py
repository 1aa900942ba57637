import itertools

import pytest

from drake_srg.common.safety_states import STATES, SafetyState, StopReason
from drake_srg.safety.states import TRANSITIONS, Observation, transition

RUNNING, BRAKING = SafetyState.RUNNING, SafetyState.BRAKING
PROTECTIVE, EMERGENCY = SafetyState.PROTECTIVE_STOP, SafetyState.EMERGENCY_STOP
SPEED, PRESSED = StopReason.SPEED, StopReason.EMERGENCY_STOP
ALL = [
    Observation(reason, braked_for, standstill, released)
    for reason, braked_for, standstill, released in itertools.product(
        StopReason, (SPEED, PRESSED), (False, True), (False, True)
    )
]


@pytest.mark.parametrize(
    ("state", "observation", "following"),
    [
        (RUNNING, Observation(), RUNNING),
        (RUNNING, Observation(SPEED), BRAKING),
        (BRAKING, Observation(braked_for=SPEED), BRAKING),
        (BRAKING, Observation(braked_for=SPEED, standstill=True), PROTECTIVE),
        (BRAKING, Observation(braked_for=PRESSED, standstill=True), EMERGENCY),
        (PROTECTIVE, Observation(released=True), RUNNING),
        (PROTECTIVE, Observation(SPEED, released=True), PROTECTIVE),
        (PROTECTIVE, Observation(PRESSED), EMERGENCY),
        (EMERGENCY, Observation(released=True), RUNNING),
        (EMERGENCY, Observation(PRESSED, released=True), EMERGENCY),
    ],
)
def test_transitions(state, observation, following):
    assert transition(state, observation) is following


def test_every_state_has_a_row():
    assert list(TRANSITIONS) == STATES


@pytest.mark.parametrize("state", [BRAKING, PROTECTIVE, EMERGENCY])
def test_nothing_but_a_release_without_a_cause_starts_the_arm(state):
    for o in ALL:
        if transition(state, o) is RUNNING:
            assert o.released
            assert o.reason is StopReason.NONE


@pytest.mark.parametrize("state", STATES)
def test_no_reason_to_stop_is_passed_over(state):
    for o in ALL:
        if o.reason is not StopReason.NONE:
            assert transition(state, o) is not RUNNING
