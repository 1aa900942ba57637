import numpy as np
import pytest

from bridges.test_serve import series, serve
from drake_srg.bridges.commands import CommandError, CommandInbox, Warnings
from drake_srg.bridges.safety_commands import safety_topics
from drake_srg.common.safety_states import SafetyState, StopReason, safety_state

HOME = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.5, 0.0])
THERE, ELSEWHERE = HOME + 0.3, HOME - 0.1
PORTS = (
    "arm.position_commanded",
    "arm.position_allowed",
    "safety.state",
    "safety.speed_scale",
)
TOPICS = {topic.name: topic for topic in safety_topics(["safety.estop"])}


def run(script, until, told=None):
    """Serve a kitchen with a monitor; `script` has the messages by time."""
    left = dict(script)

    def act(bridge):
        for time in [time for time in left if bridge.time >= time]:
            for topic, data in left.pop(time).items():
                bridge.inbox.receive(topic, data)

    tell = (lambda text: None) if told is None else told.append
    bridge, _ = serve(
        act,
        until,
        overrides=["safety={}", "object.present=false"],
        ports=PORTS,
        tell=tell,
        wanted=lambda _: False,
    )
    return bridge


def test_a_button_pressed_for_less_than_a_period_is_seen():
    inbox = CommandInbox(TOPICS.values(), Warnings(print))
    taken = []
    for messages in ([True, False], [], [True], [False, True], [False], []):
        for message in messages:
            inbox.receive("/estop", message)
        taken.append({port: value[0] for port, value in inbox.take().items()})
    up, down = {"safety.estop": 0.0}, {"safety.estop": 1.0}
    assert taken == [down, up, down, down, up, {}]


def state_at(bridge, time):
    times, states = series(bridge, "safety.state")
    return safety_state(states[np.searchsorted(times, time)])


@pytest.fixture(scope="module")
def pressed():
    told = []
    script = {
        0.1: {"/kuka": THERE},
        0.8: {"/estop": True},
        1.2: {"/estop": False, "/kuka": ELSEWHERE},
        1.4: {"/release": True},
        1.7: {"/kuka": HOME},
    }
    return run(script, 3.2, told), told


def test_the_button_stops_the_arm_within_its_limits(pressed):
    times, allowed = series(pressed[0], "arm.position_allowed")
    assert state_at(pressed[0], 1.1) == (
        SafetyState.EMERGENCY_STOP,
        StopReason.EMERGENCY_STOP,
    )
    stopped = (times > 0.9) & (times < 1.4)
    assert np.ptp(allowed[stopped], axis=0).max() == 0.0
    acceleration = np.diff(allowed, 2, axis=0) / 0.005**2
    assert np.abs(acceleration).max() < 1.002 * 2.0 * 8.57


def test_no_command_from_before_the_release_moves_the_arm(pressed):
    times, allowed = series(pressed[0], "arm.position_allowed")
    assert state_at(pressed[0], 1.6) == (SafetyState.RUNNING, StopReason.NONE)
    still = (times > 0.9) & (times < 1.69)
    assert np.ptp(allowed[still], axis=0).max() == 0.0
    assert np.abs(allowed[-1] - HOME).max() < 0.02


def test_the_stop_is_told_once(pressed):
    assert pressed[1] == [
        "the arm is stopped (emergency_stop); /kuka waits for a /release"
    ]


def test_silence_stops_the_arm_once_a_heartbeat_has_begun():
    script = {
        0.1: {"/kuka": THERE},
        0.3: {"/heartbeat": True},
        0.34: {"/heartbeat": True},
    }
    bridge = run(script, 0.8)
    assert state_at(bridge, 0.38)[0] is SafetyState.RUNNING
    assert state_at(bridge, 0.41)[1] is StopReason.STALE
    assert (
        state_at(run({**script, 0.36: {"/heartbeat": False}}, 0.8), 0.79)[0]
        is SafetyState.RUNNING
    )


def test_the_speed_override_is_in_percent():
    bridge = run({0.05: {"/speed_override": 50}, 0.1: {"/kuka": THERE}}, 0.6)
    _, scale = series(bridge, "safety.speed_scale")
    assert scale[-1, 0] == pytest.approx(0.5, abs=0.01)


def test_commands_are_checked():
    assert safety_topics(["arm.position_desired"]) == []
    for percent in (-1, 101):
        with pytest.raises(CommandError, match="must be 0 to 100 percent"):
            TOPICS["/speed_override"].convert(percent)
