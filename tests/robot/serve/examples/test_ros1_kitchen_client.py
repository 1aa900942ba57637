import contextlib
import importlib.util
from pathlib import Path

import numpy as np
import pytest

from drake_srg.robot.serve.commands import CommandInbox, CommandTopic, Warnings
from drake_srg.robot.serve.ros1.bridge import Ros1Bridge
from drake_srg.scenario import load_scenario
from robot.serve.ros1.peers import wait_until

EXAMPLE = Path(__file__).parents[4] / "examples" / "ros1_kitchen_client.py"


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("ros1_kitchen_client", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_the_client_sends_the_messages_of_the_scenario(example):
    played = load_scenario("thesis_kitchen").planner.messages

    def entry(message):
        if message.grasp is not None:
            return {"grasp": message.grasp}
        return {"kuka": message.kuka, "count": message.count}

    routines = {name: [*map(entry, r)] for name, r in played.routines.items()}
    assert routines == example.ROUTINES
    assert [call.routine for call in played.sequence] == example.SEQUENCE
    sent = [m for routine in example.SEQUENCE for m in example.messages(routine)]
    assert len(sent) == played.number()


@pytest.mark.slow
@pytest.mark.ros
def test_every_message_arrives_in_order(example, own_roscore, told):
    own_roscore.start()  # one that knows no nodes of other tests
    received = []

    def keep(topic):
        def convert(data):
            received.append((topic, np.asarray(data).tolist()))
            return {}

        return convert

    inbox = CommandInbox(
        [
            CommandTopic("/kuka", "std_msgs/msg/Float64MultiArray", keep("/kuka")),
            CommandTopic("/grasp", "std_msgs/msg/Int32", keep("/grasp")),
        ],
        Warnings(told.append),
    )
    with contextlib.closing(Ros1Bridge(inbox, [], master=own_roscore.uri)):
        # A hundred times as fast as in the thesis.
        printed = own_roscore.run("/usr/bin/python3", EXAMPLE, "--rate", "2500")
        sent = [m for routine in example.SEQUENCE for m in example.messages(routine)]
        assert wait_until(lambda: inbox.received == len(sent)), printed
    for topic in ("/kuka", "/grasp"):
        assert [d for t, d in received if t == topic] == [
            pytest.approx(d) for t, d in sent if t == topic
        ]
    assert told == []
