import pytest
from helpers import fix, port_table, update

from drake_srg.gripper.underactuation import UnderactuationConfig, UnderactuationLogic
from gripper.underactuation_case import NAN, given_inputs, make, targets


def per_message(closure=0.5, q=(0.0,) * 4, messages=0, **config):
    system, context = make(closure, q, evaluate="per_message", **config)
    fix(system, context, closure_messages=float(messages))
    return system, context


def test_per_message_has_a_port_that_counts_messages():
    inputs, _ = port_table(
        UnderactuationLogic(UnderactuationConfig(evaluate="per_message"))
    )
    assert inputs["closure_messages"] == 1


def test_the_algorithm_runs_only_when_a_message_has_arrived():
    system, context = per_message()
    assert targets(system, context).tolist() == [0.0] * 4
    fix(system, context, closure_messages=1.0)
    assert targets(system, context).tolist() == [1.5, 1.5, 0.0, 0.0]
    # A sensor that fires changes nothing by itself ...
    given_inputs(system, context, 0.5, [0.5] * 4, [1, 1, 0, 0])
    assert targets(system, context).tolist() == [1.5, 1.5, 0.0, 0.0]
    # ... until the next message arrives, with the same number.
    fix(system, context, closure_messages=2.0)
    assert targets(system, context).tolist() == [1.5, 1.5, 1.0, 1.0]


def test_overrides_and_hold_need_no_message():
    system, context = per_message(messages=1)
    update(system, context)
    fix(system, context, joint_position_commanded=[0.2, NAN, NAN, NAN])
    assert targets(system, context) == pytest.approx([0.2, 1.5, 0.0, 0.0])
    given_inputs(system, context, 0.5, [0.3] * 4, [0] * 4)
    fix(system, context, hold=1.0)
    assert targets(system, context) == pytest.approx([0.3] * 4)


def test_a_message_that_arrives_during_a_hold_counts_after_it():
    system, context = per_message()
    fix(system, context, hold=1.0, closure_messages=1.0)
    assert targets(system, context).tolist() == [0.0] * 4
    fix(system, context, hold=0.0)
    assert targets(system, context).tolist() == [1.5, 1.5, 0.0, 0.0]


def test_messages_that_nobody_counts_are_an_error():
    system, context = make(evaluate="per_message")
    with pytest.raises(RuntimeError, match=r"per_message needs .* closure_messages"):
        update(system, context)
