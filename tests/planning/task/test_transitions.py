import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.planning.task.config import PlannerConfig
from drake_srg.planning.task.transitions import TRANSITIONS, Observation, transition
from drake_srg.types import Failure, Mode

CONFIG = PlannerConfig(verify_time=0.1, gripper_timeout=1.5)
CYCLE = [mode for mode in Mode if mode is not Mode.FAILED]

observations = st.builds(
    Observation,
    ready=st.booleans(),
    arrived=st.booleans(),
    still=st.booleans(),
    holding=st.booleans(),
    clear=st.booleans(),
    at_goal=st.booleans(),
    failure=st.none() | st.sampled_from(Failure),
)
times = st.floats(0, 5)
modes = st.sampled_from(Mode)


@pytest.mark.parametrize(
    ("mode", "observed", "t", "expected"),
    [
        (Mode.IDLE, {}, 9, Mode.IDLE),
        (Mode.IDLE, {"ready": True}, 0, Mode.PRE_GRASP),
        (Mode.IDLE, {"failure": Failure.NOT_SEEN, "ready": True}, 0, Mode.FAILED),
        (Mode.PRE_GRASP, {}, 9, Mode.PRE_GRASP),
        (Mode.PRE_GRASP, {"arrived": True}, 0, Mode.GRASP),
        (Mode.GRASP, {}, 9, Mode.GRASP),
        (Mode.GRASP, {"arrived": True}, 0, Mode.CLOSE),
        (Mode.CLOSE, {"still": True}, 1.4, Mode.CLOSE),
        (Mode.CLOSE, {"holding": True}, 1.4, Mode.CLOSE),
        # Open fingers beside an object, before they begin to move.
        (Mode.CLOSE, {"holding": True, "still": True}, 0.1, Mode.CLOSE),
        (Mode.CLOSE, {"holding": True, "still": True}, 0.2, Mode.VERIFY),
        (Mode.CLOSE, {}, 1.5, Mode.VERIFY),
        (Mode.VERIFY, {"holding": True}, 0.05, Mode.VERIFY),
        (Mode.VERIFY, {"holding": True}, 0.1, Mode.LIFT),
        (Mode.VERIFY, {}, 0, Mode.RELEASE),
        (Mode.VERIFY, {}, 0.1, Mode.RELEASE),
        (Mode.LIFT, {"holding": True}, 9, Mode.LIFT),
        (Mode.LIFT, {}, 9, Mode.LIFT),
        (Mode.LIFT, {"arrived": True}, 0, Mode.RELEASE),
        (Mode.LIFT, {"arrived": True, "holding": True}, 0, Mode.TRANSFER),
        (Mode.TRANSFER, {}, 9, Mode.TRANSFER),
        (Mode.TRANSFER, {"arrived": True}, 0, Mode.RELEASE),
        (Mode.TRANSFER, {"arrived": True, "holding": True}, 0, Mode.TRANSFER),
        (
            Mode.TRANSFER,
            {"arrived": True, "holding": True, "ready": True},
            0,
            Mode.PLACE,
        ),
        (Mode.PLACE, {}, 9, Mode.PLACE),
        (Mode.PLACE, {"arrived": True}, 0, Mode.RELEASE),
        (Mode.RELEASE, {"clear": True}, 1.4, Mode.RELEASE),
        (Mode.RELEASE, {"still": True}, 1.4, Mode.RELEASE),
        (Mode.RELEASE, {"clear": True, "still": True}, 0, Mode.RETREAT),
        (Mode.RELEASE, {}, 1.5, Mode.RETREAT),
        (Mode.RETREAT, {}, 9, Mode.RETREAT),
        (Mode.RETREAT, {"arrived": True}, 0, Mode.HOME),
        (Mode.HOME, {"at_goal": True}, 9, Mode.HOME),
        (Mode.HOME, {"arrived": True, "at_goal": True}, 0, Mode.DONE),
        (
            Mode.HOME,
            {"arrived": True, "at_goal": True, "last_cycle": False},
            0,
            Mode.IDLE,
        ),
        (Mode.HOME, {"arrived": True}, 0, Mode.IDLE),
        (Mode.IDLE, {"stuck": True}, 0, Mode.RETREAT),
        (Mode.PRE_GRASP, {"moved": True}, 9, Mode.PRE_GRASP),
        (Mode.PRE_GRASP, {"arrived": True, "moved": True}, 0, Mode.IDLE),
        (Mode.HOME, {"arrived": True, "failure": Failure.DROPPED}, 0, Mode.FAILED),
    ],
)
def test_transitions(mode, observed, t, expected):
    assert transition(mode, Observation(**observed), t, CONFIG) is expected


def test_every_mode_can_be_reached():
    reached, edge = set(), {Mode.IDLE}
    while edge:
        reached |= edge
        edge = {following for mode in edge for _, following in TRANSITIONS[mode]}
        edge -= reached
    assert reached == set(Mode)


@given(modes, observations, times)
def test_what_follows_is_in_the_table(mode, o, t):
    following = {mode, Mode.FAILED, *(m for _, m in TRANSITIONS[mode])}
    assert transition(mode, o, t) in following


@given(st.sampled_from([Mode.DONE, Mode.FAILED]), observations, times)
def test_the_end_is_the_end(mode, o, t):
    assert transition(mode, o, t) is mode


@given(st.sampled_from(CYCLE[:-1]), observations, times)
def test_a_spent_budget_and_a_stop_end_every_mode(mode, o, t):
    for failure in (Failure.TIME_BUDGET, Failure.STOPPED):
        observed = Observation(**{**vars(o), "failure": failure})
        assert transition(mode, observed, t) is Mode.FAILED


@given(modes, observations, times)
def test_the_arm_lifts_and_carries_only_what_it_holds(mode, o, t):
    following = transition(mode, o, t)
    if following is not mode and following in (Mode.LIFT, Mode.TRANSFER, Mode.PLACE):
        assert o.holding
        assert mode is CYCLE[CYCLE.index(following) - 1]
