"""The hand's topics between two participants on loopback."""

import json
import time

import pytest
from helpers import NEEDS_DDS

from drake_srg.gripper.srg_tendon_driver import SrgTendonDriver
from drake_srg.robot.serve.commands import CommandInbox, Warnings
from drake_srg.robot.serve.dex1.hand import Phase
from drake_srg.robot.serve.dynamixel.bridge import WiredGripper
from robot.serve.ros2.peers import free_domain

pytestmark = NEEDS_DDS


class Peer:
    """A humanoid's controller, which sees a hand and drives its clock."""

    def __init__(self, inbox, side, participant):
        from cyclonedds.pub import DataWriter
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        from drake_srg.robot.serve.dex1 import messages
        from drake_srg.robot.serve.dex1.bridge import Dex1Bridge
        from robot.serve.dynamixel.fake_station import FakeMotor

        def topic(name, type):
            return Topic(participant, name, type)

        self._types = messages
        gripper = WiredGripper(SrgTendonDriver())
        self.bridge = Dex1Bridge(participant, inbox, gripper, side)
        self.motor = FakeMotor(inbox, self.bridge.ports)
        self.commands = DataWriter(
            participant, topic(f"rt/dex1/{side}/cmd", messages.MotorCmds)
        )
        self.strings = {
            name: DataWriter(participant, topic(name, messages.String))
            for name in (f"rt/gripper/{side}/cmd_direct", f"rt/ezgripper/{side}/admin")
        }
        self.state = DataReader(
            participant, topic(f"rt/dex1/{side}/state", messages.MotorStates)
        )
        self.reports = {
            name: DataReader(participant, topic(name, messages.String))
            for name in (
                f"rt/gripper/{side}/state_direct",
                f"rt/gripper/{side}/telemetry",
                f"rt/ezgripper/{side}/state",
            )
        }
        self.last = {}

    def move(self, *angles):
        rest = dict.fromkeys(("dq", "tau", "kp", "kd"), 0.0)
        make = self._types.MotorCmd
        cmds = [make(mode=0, q=q, reserve=[0, 0, 0], **rest) for q in angles]
        self.commands.write(self._types.MotorCmds(cmds=cmds))

    def say(self, topic, text):
        (writer,) = (w for name, w in self.strings.items() if name.endswith(topic))
        writer.write(self._types.String(data=text))

    def calibrate(self):
        """Wait until the hand's calibration has ended and is told."""
        while self.bridge.hand.phase in (Phase.CLOSING, Phase.SETTLING):
            self.run(0.1)
        self.run(0.1)

    def run(self, duration):
        """Return how many states and reports came."""
        states, reports, end = 0, 0, self.motor.time + duration
        while self.motor.time < end:
            self.bridge.update(*self.motor.step())
            for sample in self.state.take(10):
                states, self.last["state"] = states + 1, sample.states[0]
            for name, reader in self.reports.items():
                for sample in reader.take(10):
                    reports += "telemetry" in name
                    self.last[name.rpartition("/")[2]] = json.loads(sample.data)
        return states, reports


@pytest.fixture
def participant(monkeypatch):
    from drake_srg.robot.serve.ros2.bridge import open_participant

    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)
    with open_participant(free_domain(), "127.0.0.1", "hands", 2**20) as participant:
        yield participant


@pytest.fixture
def new(told, participant):
    """The peer of a hand that has just begun to calibrate."""
    return Peer(CommandInbox([], Warnings(told.append)), "left", participant)


@pytest.fixture
def peer(new):
    new.calibrate()
    return new


def test_it_starts_by_calibrating(peer, told):
    assert peer.last["telemetry"]["calibration"] == {
        "is_calibrated": True,
        "offset": 1473,  # 2.8 rad from 3298
    }
    assert told == []


def test_a_calibration_that_does_not_open_half_is_told(new, told):
    step = new.motor.step

    def stuck():  # once the fingers meet
        time, values = step()
        if new.bridge.hand.phase is Phase.SETTLING:
            new.motor.angle = new.motor.meets
        return time, values

    new.motor.step = stuck
    new.calibrate()
    assert new.last["telemetry"]["calibration"]["is_calibrated"] is False
    assert told == ["hand: has not opened half; calibrate again"]


def test_states_come_at_200_hz_and_telemetry_at_30(peer):
    states, reports = peer.run(2.0)
    assert states == pytest.approx(400, abs=2)
    assert reports == pytest.approx(60, abs=1)


def test_angles_go_from_closed_to_open(peer):
    peer.move(5.4)
    peer.run(3.0)
    assert peer.last["state"].q == pytest.approx(5.4, abs=0.06)
    assert peer.last["telemetry"]["position"]["commanded_pct"] == 100.0
    peer.move(-1.0)
    peer.run(3.0)
    assert peer.last["state"].q == pytest.approx(0.0, abs=0.06)
    assert peer.last["state"].temperature == 30


def test_a_grasp_is_seen_on_every_topic(peer):
    peer.motor.meets = 1.5
    peer.move(0.0)
    peer.run(3.0)
    assert (peer.last["state"].mode, peer.last["state"].tau_est) == (3, 1.5)
    telemetry = peer.last["telemetry"]
    assert (telemetry["state"], telemetry["contact"]) == ("grasping", True)
    assert telemetry["position"]["actual_pct"] == pytest.approx(33.9, abs=0.1)
    # 15 % of 1600 units of 3.36 mA.
    assert telemetry["hardware"]["current_ma"] == pytest.approx(806, abs=10)
    assert (
        telemetry["hardware"] | {"temperature_c": 30, "error_code": 0}
        == (telemetry["hardware"])
    )
    assert peer.last["state_direct"]["force_limit_pct"] == 15.0
    peer.move(0.6 * 5.4)
    peer.run(3.0)
    assert peer.last["state_direct"]["position_pct"] == pytest.approx(60.0, abs=1.0)


def test_the_most_recent_of_both_commands_wins(peer):
    peer.move(0.0)
    peer.run(0.1)
    peer.say("cmd_direct", '{"position_pct": 80, "force_limit_pct": 40}')
    peer.run(3.0)
    assert peer.last["state_direct"]["position_pct"] == pytest.approx(80, abs=1)
    assert peer.last["state_direct"]["force_limit_pct"] == 40.0


def test_a_faulty_hand_obeys_nothing_until_its_errors_are_cleared(peer, told):
    peer.motor.temperature = 90.0
    peer.run(0.2)
    peer.motor.temperature = 30.0
    peer.move(0.0)
    peer.run(1.0)
    assert peer.motor.pwm == 0.0
    assert any("hand: overheating; it waits for action 3" in text for text in told)
    state = peer.last["state"]
    assert (state.mode, state.lost, state.q) == (255, 2**32 - 1, 0.0)
    assert peer.last["telemetry"]["state"] == "error"
    assert peer.last["telemetry"]["hardware"]["error_code"] == 4
    peer.say("admin", '{"action": 3, "parameters": {}}')
    peer.run(5.0)
    assert peer.last["state"].mode != 255
    assert peer.last["state"].q == pytest.approx(0.0, abs=0.06)
    assert peer.bridge.hand.zero == 1473


def test_it_calibrates_on_request(peer):
    peer.motor.meets = 2.5
    peer.say("admin", '{"action": 2}')
    peer.run(0.1)
    peer.calibrate()
    assert peer.last["telemetry"]["calibration"] == {
        "is_calibrated": True,
        "offset": peer.bridge.hand.zero,
    }
    assert peer.bridge.hand.zero == 1668


@pytest.mark.parametrize(
    ("topic", "text", "words"),
    [
        ("cmd_direct", "close", "must be a JSON object, got 'close'"),
        ("cmd_direct", "[1]", "must be a JSON object"),
        ("cmd_direct", '{"position_pct": 120}', "position_pct must be 0 to 100"),
        (
            "cmd_direct",
            '{"position_pct": NaN, "force_limit_pct": 1}',
            "position_pct must be 0 to 100, got nan",
        ),
        (
            "cmd_direct",
            '{"position_pct": 1, "force_limit_pct": true}',
            "force_limit_pct must be 0 to 100, got True",
        ),
        ("admin", '{"action": 7}', "action must be 0 to 3, got 7"),
    ],
)
def test_bad_messages_are_refused(new, told, topic, text, words):
    before = new.bridge.hand.commanded
    new.say(topic, text)
    new.run(0.1)
    assert len(told) == 1 and words in told[0]
    assert new.bridge.hand.commanded == before


@pytest.mark.parametrize("angles", [(), (float("nan"),)])
def test_bad_angles_are_refused(new, told, angles):
    new.move(*angles)
    new.run(0.1)
    assert len(told) == 1 and "rt/dex1/left/cmd: " in told[0]


def test_messages_come_by_the_names_of_the_sdk(new, participant):
    from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication

    reader = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
    end, found = time.monotonic() + 10.0, {}
    while len(found) < 7 and time.monotonic() < end:
        found |= {s.topic_name: s.type_name for s in reader.take(20)}
    assert found["rt/dex1/left/state"] == "unitree_go::msg::dds_::MotorStates_"
    assert found["rt/dex1/left/cmd"] == "unitree_go::msg::dds_::MotorCmds_"
    assert found["rt/gripper/left/telemetry"] == "std_msgs::msg::dds_::String_"
