import pytest

from drake_srg.recording import rosbag
from drake_srg.robot.serve.bridge import Outlet
from drake_srg.robot.serve.commands import Warnings
from robot.serve.fake_bridge import FakeBridge

CLOCK = rosbag.clock()


class Failing(FakeBridge):
    def publish(self, topic, time, values):
        raise RuntimeError("broken line")

    def update(self, time, values):
        raise RuntimeError("broken line")


@pytest.fixture
def warnings(told):
    return Warnings(told.append)


def test_messages_go_to_the_bridges_with_subscribers(warnings):
    listening = FakeBridge(wanted=lambda name: name == "/clock")
    deaf = FakeBridge(wanted=lambda name: False)
    outlet = Outlet([listening, deaf], warnings)
    assert outlet.has_subscribers("/clock")
    assert not outlet.has_subscribers("/joint_states")
    outlet.send(CLOCK, 1.0, [])
    assert (listening.messages, deaf.messages) == ({"/clock": [(1.0, [])]}, {})


def test_each_bridge_gets_the_values_of_its_ports(warnings):
    one, other = FakeBridge(ports=["a"]), FakeBridge(ports=["a", "b"])
    Outlet([one, other], warnings).update(0.5, {"a": 1, "b": 2, "c": 3})
    assert one.updates == [(0.5, {"a": 1})]
    assert other.updates == [(0.5, {"a": 1, "b": 2})]


def test_a_failing_bridge_is_reported_once_a_task_and_stops_no_other(warnings, told):
    good = FakeBridge()
    outlet = Outlet([Failing(), good], warnings)
    for time in (0.0, 0.1):
        outlet.send(CLOCK, time, [])
        outlet.update(time, {})
    assert len(good.messages["/clock"]) == len(good.updates) == 2
    assert told == [
        "Failing /clock: RuntimeError('broken line')",
        "Failing update: RuntimeError('broken line')",
    ]
