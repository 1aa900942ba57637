import itertools

import numpy as np
import pytest

from drake_srg.common.safety_states import (
    REASONS,
    STATES,
    SafetyState,
    StopReason,
    describe_safety,
    safety_state,
    state_indices,
)


def test_indices_tell_state_and_reason():
    for state, reason in itertools.product(STATES, REASONS):
        assert safety_state(np.array(state_indices(state, reason))) == (state, reason)


@pytest.mark.parametrize(
    ("state", "reason", "text"),
    [
        (SafetyState.RUNNING, StopReason.NONE, "running"),
        (SafetyState.BRAKING, StopReason.STALE, "braking: stale"),
    ],
)
def test_texts(state, reason, text):
    assert describe_safety(np.array(state_indices(state, reason))) == text
