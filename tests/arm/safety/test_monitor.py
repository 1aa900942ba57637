import itertools

import numpy as np
import pytest
from helpers import read
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator

from arm.safety.stand import (
    LIMITS,
    PERIOD,
    STOP,
    UPPER,
    Stand,
    curve,
    distance_to_line,
    steps,
)
from drake_srg.arm.safety.config import SafetyConfig
from drake_srg.arm.safety.limits import ToolLimits, TouchLimits
from drake_srg.arm.safety.monitor import TRANSITIONS, Observation, transition
from drake_srg.common.geometry import minimum_jerk_blend
from drake_srg.common.safety_states import STATES, SafetyState, StopReason

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


NAN = [np.nan]
RIGHT = np.array([1.0, 0.0])
STOPPED = (SafetyState.PROTECTIVE_STOP, SafetyState.EMERGENCY_STOP)


def braked(stand, **inputs):
    """Go on with the commands of a curve under way until the arm rests."""
    return stand.follow(curve(100, first=stand.ticks), **inputs)


def moving(config=None, **limits):
    """Return a stand whose arm is under way on the curve."""
    stand = Stand(config, **limits)
    stand.follow(curve(200))
    assert stand.state is SafetyState.RUNNING
    return stand


def test_good_commands_pass_unchanged():
    stand, commands = Stand(), curve(200)
    np.testing.assert_array_equal(stand.follow(commands)[1:], commands)
    assert stand.speed_scale == 1.0


@pytest.mark.parametrize("periods", [-0.6, 0.0])  # to the next update
def test_outputs_change_in_updates_alone(periods):
    stand = moving()
    names = ("position_allowed", "position_held", "state", "speed_scale")
    before = [read(stand.system, stand.context, name) for name in names]
    stand.fix(position_commanded=curve(1, first=200)[0], estop=1.0)
    stand.context.SetTime((stand.ticks + periods) * PERIOD)
    for name, value in zip(names, before, strict=True):
        np.testing.assert_array_equal(read(stand.system, stand.context, name), value)
    assert not stand.system.HasAnyDirectFeedthrough()


# Every limit acts: (inputs that break it, the reason)
MEASURED = np.array([*curve(1, first=200)[0], 0.0, 0.0])
CONDITIONS = {
    "estop": ({"estop": 1.0}, StopReason.EMERGENCY_STOP),
    "estop unknown": ({"estop": np.nan}, StopReason.EMERGENCY_STOP),
    "silent": ({"heartbeat": np.nan}, StopReason.STALE),
    "stale": ({"heartbeat": 200 * PERIOD - 0.11}, StopReason.STALE),
    "lost encoder": (
        {"state_measured": MEASURED * NAN},
        StopReason.MEASURED_NOT_FINITE,
    ),
    "not there": (
        {"state_measured": MEASURED + np.array([0.3, 0.0, 0.0, 0.0])},
        StopReason.FOLLOWING_ERROR,
    ),
    "too fast": (
        {"state_measured": MEASURED + np.array([0.0, 0.0, 0.0, 2.0])},
        StopReason.MEASURED_SPEED,
    ),
    "touched": ({"external_torque": [0.0, -5.0]}, StopReason.EXTERNAL_TORQUE),
    "lost torque sensor": (
        {"external_torque": [np.nan, 0.0]},
        StopReason.MEASURED_NOT_FINITE,
    ),
}
TOUCH = TouchLimits(np.array([4.0, 4.0]))


@pytest.mark.parametrize(("inputs", "reason"), CONDITIONS.values(), ids=CONDITIONS)
def test_a_condition_stops_the_arm_on_its_path(inputs, reason):
    stand = moving(touch=TOUCH)
    stand.tick(curve(1, first=200)[0], **inputs)
    assert (stand.state, stand.reason) == (SafetyState.BRAKING, reason)
    still = {n: v for n, v in inputs.items() if n not in ("state_measured",)}
    stand.follow(curve(100, first=201), **still)
    assert stand.state in STOPPED
    path = np.vstack([np.zeros(2), curve(400)])
    assert np.max(distance_to_line(stand.allowed, path)) < 1e-9
    first, second = steps(np.array(stand.allowed))
    assert first.max() <= 1.0
    assert second.max() <= 1.0 + 1e-6


def test_a_stop_takes_no_longer_than_the_limits_need():
    stand = moving()
    speed = (stand.allowed[-1] - stand.allowed[-2]) / PERIOD
    braked(stand, estop=1.0)
    stopped = np.flatnonzero((np.diff(stand.allowed, axis=0) == 0.0).all(axis=1))
    after = stopped[stopped > 200][0] - 200
    # The curve bends, which takes its share of the deceleration.
    assert after * PERIOD <= np.max(np.abs(speed)) / (STOP - 12.0) + PERIOD


# Commands that break a limit of their own: (changes of a good command, the reason)
BAD = {
    "lost": (NAN, StopReason.NOT_FINITE),
    "infinite": ([np.inf, 0.0], StopReason.NOT_FINITE),
    "jump": ([0.3, 0.0], StopReason.SPEED),
    "kick": ([0.0, 1.5e-3], StopReason.ACCELERATION),
}


@pytest.mark.parametrize(("change", "reason"), BAD.values(), ids=BAD)
def test_a_bad_command_is_not_followed(change, reason):
    stand = moving()
    stand.tick(curve(1, first=200)[0] + change)
    assert (stand.state, stand.reason) == (SafetyState.BRAKING, reason)
    braked(stand)
    assert stand.state is SafetyState.PROTECTIVE_STOP
    first, second = steps(np.array(stand.allowed))
    assert first.max() <= 1.0
    assert second.max() <= 1.0 + 1e-6
    # It goes straight on from the last good command.
    direction = curve(1, first=199)[0] - curve(1, first=198)[0]
    gone = stand.allowed[-1] - curve(1, first=199)[0]
    assert abs(direction[0] * gone[1] - direction[1] * gone[0]) <= 1e-12
    assert np.dot(direction, gone) > 0.0


def test_a_joint_stops_before_its_limit():
    stand = Stand()
    q, step = np.zeros(2), np.zeros(2)
    while stand.state is SafetyState.RUNNING:
        step = np.minimum(step + 0.9 * RIGHT * LIMITS.bend, 0.9 * LIMITS.step)
        q = q + step
        stand.tick(q)
    assert stand.reason is StopReason.POSITION
    allowed = stand.rest()
    assert UPPER[0] - 0.1 < allowed[-1][0] <= UPPER[0]


def test_the_tool_stays_slow_and_inside():
    def position(q):
        return np.array([2.0 * q[0], 0.0, 0.0])

    slow = Stand(tool=ToolLimits(position, step=0.4 * PERIOD))
    slow.follow(curve(200))
    assert slow.reason is StopReason.TOOL_SPEED
    box = ToolLimits(position, lower=np.full(3, -0.5), upper=np.full(3, 0.5))
    inside = Stand(tool=box)
    allowed = inside.follow(curve(200))
    assert inside.reason is StopReason.WORKSPACE
    assert 0.8 * 0.25 < allowed[:, 0].max() <= 0.25


def test_a_protective_stop_goes_on_along_the_path_once_it_is_released():
    stand = moving(touch=TOUCH)
    braked(stand, external_torque=[5.0, 0.0], release=0.0)
    assert stand.state is SafetyState.PROTECTIVE_STOP
    end = stand.allowed[-1]
    stand.tick(curve(1, first=300)[0], release=1.0)
    assert stand.state is SafetyState.PROTECTIVE_STOP  # it is still touched
    stand.tick(curve(1, first=301)[0], external_torque=[0.0, 0.0])
    assert stand.state is SafetyState.PROTECTIVE_STOP  # a held button is no release
    stand.tick(curve(1, first=302)[0], release=0.0)
    stand.tick(curve(1, first=303)[0], release=1.0)
    assert (stand.state, stand.reason) == (SafetyState.RUNNING, StopReason.NONE)
    goal = curve(1, first=303)[0]
    # The planner's motion ends abruptly in this test, so go on until it has caught up.
    stand.follow(curve(150, first=304))
    assert stand.state is SafetyState.RUNNING
    assert np.linalg.norm(goal - end) > 0.1
    path = np.vstack([[0, 0], curve(460)])
    assert np.max(distance_to_line(stand.allowed, path)) < 1e-9


def test_after_an_emergency_stop_the_arm_waits_for_commands_where_it_rests():
    stand = moving()
    braked(stand, estop=1.0, release=0.0)
    assert stand.state is SafetyState.EMERGENCY_STOP
    stand.tick(curve(1, first=300)[0], release=1.0)
    assert stand.state is SafetyState.EMERGENCY_STOP  # the button is still pressed
    stand.tick(curve(1, first=301)[0], estop=0.0, release=0.0)
    stand.tick(curve(1, first=302)[0], release=1.0)
    assert stand.state is SafetyState.RUNNING
    rest = stand.allowed[-1]
    stand.follow(curve(10, first=303))  # these are elsewhere
    assert stand.state is SafetyState.PROTECTIVE_STOP
    assert stand.reason is StopReason.SPEED
    stand.tick(rest, release=0.0)
    stand.tick(rest, release=1.0)
    allowed = stand.follow(rest + curve(100))
    np.testing.assert_array_equal(allowed[-1], (rest + curve(100))[-1])


def test_the_speed_override_slows_the_arm_down_on_its_path():
    stand = Stand(SafetyConfig(speed_override=0.5))
    s = 1.2 * np.array([minimum_jerk_blend(k / 400) for k in range(1, 401)])
    path = np.stack([0.8 * np.sin(s), 1.0 - np.cos(s)], axis=-1)
    allowed = stand.follow([*path, *[path[-1]] * 600])
    assert stand.state is SafetyState.RUNNING
    assert np.max(distance_to_line(allowed, np.vstack([[0, 0], path]))) < 1e-9
    assert np.flatnonzero((allowed == path[-1]).all(axis=1))[0] == 800
    # It came by all commands, at half their speed.
    np.testing.assert_allclose(allowed[2:801:2], path, atol=1e-12)


def test_commands_must_not_run_too_far_ahead():
    stand = Stand(SafetyConfig(speed_override=0.0, path_memory=0.5))
    stand.follow(curve(200))
    assert stand.reason is StopReason.LAG


def test_a_lost_override_stops_the_arm():
    stand = moving()
    braked(stand, speed_override=np.nan)
    assert stand.speed_scale == 0.0
    np.testing.assert_array_equal(stand.allowed[-1], stand.allowed[-20])


KINDS = ("smooth", "wild", "jump", "nan", "hold", "rejoin", "outwards")


@settings(max_examples=40)
@given(
    st.integers(0, 2**32 - 1),
    st.lists(st.sampled_from(KINDS), min_size=2, max_size=8),
    st.sampled_from([1.0, 0.7, 0.3]),
)
def test_nothing_that_is_commanded_breaks_a_limit(seed, kinds, override):
    random = np.random.default_rng(seed)
    stand = Stand(SafetyConfig(speed_override=override, path_memory=0.3))
    q, step = np.zeros(2), np.zeros(2)
    for kind in kinds:
        bend = random.uniform(-1.0, 1.0, 2) * LIMITS.bend
        if kind == "rejoin":
            q, step = stand.allowed[-1], np.zeros(2)
        # At full speed it takes 160 periods to the nearer limit.
        ticks = 200 if kind == "outwards" else random.integers(1, 40)
        if kind == "outwards":
            bend = np.sign(bend) * LIMITS.bend
        for _ in range(ticks):
            step = step + (2.0 if kind == "wild" else 0.9) * bend
            if kind in ("smooth", "outwards"):
                step = np.clip(step, -0.99 * LIMITS.step, 0.99 * LIMITS.step)
            if kind in ("hold", "rejoin"):
                step = step - np.clip(step, -LIMITS.bend, LIMITS.bend)
            q = q + step
            command = {"nan": q * np.nan, "jump": q + random.normal(0.0, 1.0, 2)}
            stand.tick(
                command.get(kind, q),
                estop=float(random.random() < 0.002),
                release=float(random.random() < 0.3),
            )
    allowed = np.array(stand.allowed)
    assert np.max(np.abs(allowed) - UPPER) <= 1e-12
    first, second = steps(allowed)
    assert first.max() <= 1.0 + 1e-9
    assert second.max() <= 1.0 + 1e-6


def test_a_simulation_gives_the_same_as_single_updates():
    stand, commands = Stand(), curve(60)
    stand.follow(commands, estop=0.0)
    system = Stand().system
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    for k, q in enumerate(commands):
        system.GetInputPort("position_commanded").FixValue(context, q)
        simulator.AdvanceTo(k * PERIOD + 0.3 * PERIOD)
    np.testing.assert_array_equal(
        read(system, context, "position_allowed"), stand.allowed[-1]
    )
