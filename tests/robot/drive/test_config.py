import pytest
from helpers import check_reads_or_refuses, damaged
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.robot.drive.arm import Ros2Arm
from drake_srg.robot.drive.config import (
    FaultsConfig,
    FaultyLink,
    load_hardware,
    parse_hardware,
)
from drake_srg.robot.drive.gripper import Ros1Gripper
from drake_srg.robot.drive.link import Link


class Counter(Link):
    def __init__(self):
        self.count, self.sent = 0, []

    def take(self):
        self.count += 1
        return {"n": self.count}

    def send(self, commands):
        self.sent.append(commands["n"])

    def close(self):
        pass


def test_latency_delays_both_directions():
    counter = Counter()
    counter.lag = 0.05
    link = FaultyLink(counter, FaultsConfig(latency=0.02), 0.005)
    assert link.lag == 0.05 + 2 * 0.02
    taken = []
    for n in range(10):
        taken.append(link.take().get("n"))
        link.send({"n": n})
    assert taken == [None] * 4 + [1, 2, 3, 4, 5, 6]
    assert counter.sent == [0, 1, 2, 3, 4, 5]


def test_a_share_of_messages_gets_lost():
    counter = Counter()
    link = FaultyLink(counter, FaultsConfig(loss=0.2), 0.005)
    arrived = 0
    for n in range(1000):
        arrived += bool(link.take())
        link.send({"n": n})
    assert 750 < arrived < 850
    assert 750 < len(counter.sent) < 850


GOOD = "arm: !Ros2Arm {lead: 0.1}\ngripper: !Ros1Gripper {}\n"


def test_tags_choose_the_drivers():
    more = "cameras: {top: !Ros2Camera {}}\nros2: {domain: 5}\n"
    config = parse_hardware(GOOD + more, "robot.yaml")
    assert type(config.arm) is Ros2Arm
    assert config.arm.lead == 0.1
    assert type(config.gripper) is Ros1Gripper
    assert [*config.cameras] == ["top"]
    assert config.ros2.domain == 5


def test_only_ros_2_has_actions():
    config = parse_hardware(GOOD.replace("lead: 0.1", "stream: action"), "robot.yaml")
    assert config.arm.action.startswith("joint_trajectory_controller/")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "arm: missing (allowed: !Ros1Arm"),
        ("arm: !Ros2Arm {}", "gripper: missing (allowed: !Ros1Gripper"),
        ("arm: !Arm {}\ngripper: !Ros2Gripper {}", "unknown tag !Arm"),
        (
            "arm: !Ros1Arm {stream: action}\ngripper: !Ros1Gripper {}",
            "arm.stream: must be one of positions, trajectory; got",
        ),
        (GOOD + "speed: 1", "unknown key 'speed'"),
        (GOOD + "ros2: {domain: 300}", "ros2.domain: must be at most 232"),
        (GOOD + "faults: {loss: 2}", "faults.loss: must be at most 1"),
    ],
)
def test_mistakes_are_named(text, words):
    with pytest.raises(ScenarioError, match=r"^robot.yaml: ") as error:
        parse_hardware(text, "robot.yaml")
    assert words in str(error.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ScenarioError, match=r"none\.yaml: cannot be read"):
        load_hardware(tmp_path / "none.yaml")


@settings(max_examples=60)
@given(data=st.data())
def test_a_broken_file_gets_one_line(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("hardware") / "robot.yaml"
    more = "cameras: {top: !Ros2Camera {}}\nros2: {domain: 5}\n"
    path.write_bytes(data.draw(damaged(f"{GOOD}{more}".encode())))
    check_reads_or_refuses(load_hardware, path)
