import numpy as np
import pytest
from helpers import read
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.scenario import load_scenario
from drake_srg.theses.script import (
    SCRIPT_MODES,
    MessageConfig,
    MessagesConfig,
    RoutineConfig,
    ScriptedPlanner,
    ScriptStep,
    message_script,
    minimum_jerk_blend,
)
from drake_srg.types import Mode

HOME = np.array([0.1, -0.2])
SCRIPT = [
    ScriptStep(mode="grasp", duration=1.0, arm=[0.5, 0.0]),
    ScriptStep(mode="close", duration=0.5, closure=0.8, force_limit=0.3),
    ScriptStep(mode="lift", duration=2.0, arm=[0.5, 0.4]),
    ScriptStep(mode="release", duration=0.5, closure=0.0),
]


@pytest.fixture
def at():
    """Return a function that reads an output port at a time."""
    planner = ScriptedPlanner(HOME, SCRIPT)
    context = planner.CreateDefaultContext()

    def read_at(port, time):
        context.SetTime(time)
        return read(planner, context, port)

    return read_at


@pytest.mark.parametrize(
    ("time", "mode", "closure", "force_limit"),
    [
        (0.0, Mode.GRASP, 0.0, np.nan),
        (0.999, Mode.GRASP, 0.0, np.nan),
        (1.0, Mode.CLOSE, 0.8, 0.3),
        (1.5, Mode.LIFT, 0.8, 0.3),
        (3.499, Mode.LIFT, 0.8, 0.3),
        (3.5, Mode.RELEASE, 0.0, 0.3),
        (4.0, Mode.DONE, 0.0, 0.3),
        (100.0, Mode.DONE, 0.0, 0.3),
    ],
)
def test_each_step_has_its_time(at, time, mode, closure, force_limit):
    assert at("mode", time) is mode
    assert at("status", time).mode is mode
    assert at("status", time).failure is None
    assert at("closure_commanded", time) == [closure]
    assert at("force_limit", time) == pytest.approx([force_limit], nan_ok=True)


@pytest.mark.parametrize(
    ("time", "messages"), [(0.999, 0), (1.0, 1), (3.4, 1), (3.5, 2), (100.0, 2)]
)
def test_each_closure_is_one_message(at, time, messages):
    assert at("closure_messages", time) == [messages]


def test_a_step_begins_at_a_time_that_is_rounded(at):
    assert at("mode", 500 * 0.002 - 1e-13) is Mode.CLOSE


@pytest.mark.parametrize(
    ("time", "position"),
    [
        (0.0, HOME),
        (0.5, [0.3, -0.1]),  # half way after half of the time
        (1.0, [0.5, 0.0]),
        (1.3, [0.5, 0.0]),  # stays
        (2.5, [0.5, 0.2]),
        (3.5, [0.5, 0.4]),
        (9.0, [0.5, 0.4]),
    ],
)
def test_the_arm_moves_from_step_to_step(at, time, position):
    np.testing.assert_allclose(at("position_commanded", time), position, atol=1e-12)


@given(st.floats(-0.5, 1.5))
def test_the_blend_never_goes_back(s):
    # The minimum-jerk polynomial is 10 s³ - 15 s⁴ + 6 s⁵.
    x = np.clip(s, 0.0, 1.0)
    assert minimum_jerk_blend(s) == pytest.approx(10 * x**3 - 15 * x**4 + 6 * x**5)
    assert 0.0 <= minimum_jerk_blend(s) <= minimum_jerk_blend(s + 0.01) <= 1.0 + 1e-12


def test_the_blend_starts_and_ends_at_rest():
    for end in (0.0, 1.0):
        speed = (minimum_jerk_blend(end + 1e-4) - minimum_jerk_blend(end - 1e-4)) / 2e-4
        assert abs(speed) < 1e-6


def test_a_script_needs_steps_that_fit_the_arm():
    with pytest.raises(ValueError, match=r"planner\.steps: needs at least one step"):
        ScriptedPlanner(HOME, [])
    with pytest.raises(
        ValueError, match=r"planner\.steps\[1\]\.arm: needs .* \(2\), got 1"
    ):
        ScriptedPlanner(HOME, [SCRIPT[0], ScriptStep(arm=[1.0])])


def test_steps_have_modes_of_a_cycle_under_way():
    assert {"grasp", "close", "lift", "transfer", "place", "home"} < set(SCRIPT_MODES)
    assert not {"idle", "done", "failed"} & set(SCRIPT_MODES)


percents = st.integers(0, 1000)
kuka = st.builds(
    MessageConfig,
    kuka=st.lists(st.floats(-170.0, 170.0), min_size=2, max_size=2),
    count=st.integers(1, 50),
)
grasp = st.builds(MessageConfig, grasp=st.tuples(percents, percents).map(list))
routines = st.lists(kuka | grasp, min_size=1, max_size=4)


def config(*messages, rate=25.0):
    return MessagesConfig(
        rate=rate,
        routines={"all": list(messages)},
        sequence=[RoutineConfig(routine="all", mode="lift")],
        rest=1.0,
    )


def sent(messages):
    """Yield what a client sends, message by message: (topic, value)."""
    for message in messages:
        if message.kuka is not None:
            yield from [("kuka", message.kuka)] * message.count
        else:
            first, last = message.grasp
            step = 1 if last >= first else -1
            for i in range(first, last + step, step):
                yield "grasp", i // 10


@given(routines, st.sampled_from([10.0, 25.0, 100.0]))
def test_the_last_messages_hold_at_any_time(messages, rate):
    planner = ScriptedPlanner(
        np.zeros(2), message_script(config(*messages, rate=rate), 2), jumps=True
    )
    context = planner.CreateDefaultContext()
    position, closure = np.zeros(2), 0.0
    all_sent = list(sent(messages))
    for k, (topic, value) in enumerate(all_sent):
        if topic == "kuka":
            position = np.deg2rad(value)
        else:
            closure = value / 100
        # Check some messages only, at their time and half way to the next.
        if k % 37 and k < len(all_sent) - 1:
            continue
        for time in (k / rate, (k + 0.5) / rate):
            context.SetTime(time)
            q = planner.GetOutputPort("position_commanded").Eval(context)
            np.testing.assert_array_equal(q, position)
            assert planner.GetOutputPort("closure_commanded").Eval(context) == [closure]
            grasps = sum(topic == "grasp" for topic, _ in all_sent[: k + 1])
            assert planner.GetOutputPort("closure_messages").Eval(context) == [grasps]
            assert planner.GetOutputPort("mode").Eval(context) is Mode.LIFT


@given(routines)
def test_a_script_takes_as_long_as_its_messages(messages):
    messages = config(*messages)
    duration = sum(step.duration for step in message_script(messages, 2))
    assert duration == pytest.approx(messages.number() / 25.0 + messages.rest)
    assert messages.number() == len(list(sent(messages.routines["all"])))


def test_a_ramp_has_one_message_per_integer():
    script = message_script(config(MessageConfig(grasp=[0, 1000])), 7)[:-1]
    assert [step.closure for step in script] == [i / 100 for i in range(101)]
    np.testing.assert_allclose([s.duration for s in script[:-1]], 0.4)
    assert script[-1].duration == pytest.approx(0.04)  # 1000 alone
    down = message_script(config(MessageConfig(grasp=[1000, 500])), 7)[:-1]
    assert [step.closure for step in down] == [i / 100 for i in range(100, 49, -1)]
    assert down[0].duration == pytest.approx(0.04)


@pytest.mark.parametrize(
    ("messages", "error"),
    [
        (
            config(MessageConfig()),
            r"messages.routines.all\[0\]: needs either kuka or grasp",
        ),
        (
            config(MessageConfig(kuka=[0.0, 0.0], grasp=[0, 1])),
            r"messages.routines.all\[0\]: needs either kuka or grasp",
        ),
        (
            config(MessageConfig(kuka=[0.0])),
            r"messages.routines.all\[0\].kuka: needs .* \(2\), got 1",
        ),
        (
            MessagesConfig(sequence=[RoutineConfig(routine="grip")]),
            r"messages.sequence\[0\].routine: unknown routine 'grip'",
        ),
        (MessagesConfig(), r"messages.sequence: needs a routine with messages"),
    ],
)
def test_invalid_messages_are_refused(messages, error):
    with pytest.raises(ValueError, match=error):
        message_script(messages, 2)


@pytest.mark.parametrize("name", ["thesis_kitchen", "thesis_kitchen_tendon"])
def test_the_demonstration_is_that_of_the_thesis(name):
    """Numbers of messages per call and in all, counted in the thesis's client."""
    scenario = load_scenario(name)
    messages = scenario.planner.messages
    assert messages.rate == 25.0
    count = {
        routine: sum(message.number for message in sent_there)
        for routine, sent_there in messages.routines.items()
    }
    assert count == {
        "startpos": 500,
        "movetocup": 600,
        "grip": 1001,
        "lift": 100,
        "placeposition": 1000,
        "open_full": 1001,
        "closehalf": 501,
        "openhalf": 501,
        "secure_start_position": 450,
    }
    assert messages.number() == 5752
    limits = scenario.arm.limits
    assert np.rad2deg([*limits.velocity, *limits.acceleration, *limits.jerk]) == (
        pytest.approx([110.0, 40.0, 80.0])
    )
