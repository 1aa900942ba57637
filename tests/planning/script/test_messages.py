import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.planning.script.scripted import (
    MessageConfig,
    MessagesConfig,
    RoutineConfig,
    ScriptedPlanner,
    message_script,
)
from drake_srg.scenario import load_scenario
from drake_srg.types import Mode

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
