import signal
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing

import numpy as np
import pytest
from pydrake.systems.sensors import CameraInfo
from rosbags.typesys import Stores, get_typestore

from drake_srg.recording import rosbag
from drake_srg.robot.serve.action_server import with_actions
from drake_srg.robot.serve.commands import CommandInbox, Warnings
from drake_srg.robot.serve.pictures import camera_topics
from drake_srg.robot.serve.ros2.bridge import (
    Ros2Bridge,
    domain_id,
    largest_message,
    open_participant,
    payload_type,
)
from robot.serve.ros2 import dds_peer
from robot.serve.ros2.peers import (
    COMMANDS,
    CyclonePeer,
    command_topics,
    free_domain,
)
from robot.serve.waiting import wait_until

JOINT_STATES = rosbag.joint_states({"arm": ["a", "b"]})
STATE = np.array([0.1, 0.2, 0.3, 0.4])
CAMERA = camera_topics("ceiling", CameraInfo(640, 480, 500.0, 510.0, 320.0, 240.0))
IMAGE = CAMERA["/camera/color/image_raw"]
PIXELS = np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8)
TOPICS = [
    rosbag.clock(),
    JOINT_STATES,
    rosbag.float64("/gripper/closure_commanded", "closure"),
    rosbag.float64_array("/gripper/proximity", "proximity", 3),
    *CAMERA.values(),
]


@pytest.fixture
def topics():
    return TOPICS


def subscribe(peer, bridge, topic, kind, reliable=True):
    peer.subscribe(topic, kind, reliable)
    assert wait_until(lambda: bridge.has_subscribers(topic) and peer.matched(topic))


# Topics, values, and fields of their messages.
SENT = [
    (TOPICS[0], [], {"clock": {"sec": 1, "nanosec": 500_000_000}}),
    (
        JOINT_STATES,
        [STATE, None],
        {
            "name": ["a", "b"],
            "position": [0.1, 0.2],
            "velocity": [0.3, 0.4],
        },
    ),
    (TOPICS[2], [[0.25]], {"data": 0.25}),
    (
        TOPICS[3],
        [[1.0, np.inf, -0.5]],
        {"layout": {"dim": [], "data_offset": 0}, "data": [1.0, np.inf, -0.5]},
    ),
    (
        IMAGE,
        [PIXELS],
        {
            "height": 480,
            "width": 640,
            "encoding": "rgb8",
            "is_bigendian": 0,
            "step": 1920,
            "data": PIXELS.reshape(-1).tolist(),
        },
    ),
    (
        CAMERA["/camera/color/camera_info"],
        [],
        {
            "height": 480,
            "width": 640,
            "distortion_model": "plumb_bob",
            "d": [0.0] * 5,
            "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        },
    ),
    (CAMERA["/blobs"], [[]], {}),
]


@pytest.mark.slow
def test_another_process_receives_the_topics(bridge, peer):
    for topic, values, expected in SENT:
        assert not bridge.has_subscribers(topic.name)
        kind = topic.type.rpartition("/")[2]
        subscribe(peer, bridge, topic.name, kind, reliable=not topic.sensor)
        bridge.publish(topic, 1.5, values)
        (message,) = wait_until(lambda name=topic.name: peer.take(name))
        if "header" in message:
            assert message["header"]["stamp"] == {"sec": 1, "nanosec": 500_000_000}
        assert {name: message[name] for name in expected} == expected, topic.name


def test_announcements_are_those_of_ros_2(bridge, peer):
    def announced():
        data = peer.user_data()
        counts = [len(data[kind]) for kind in ("publication", "subscription")]
        return data if counts == [len(TOPICS), 2 * len(COMMANDS)] else None

    data = wait_until(announced)
    assert {entry["user_data"] for entry in data["participant"]} >= {"enclave=/;"}
    offered = {entry["topic"]: entry for entry in data["publication"]}
    # Hashes as printed by `ros2 topic info -v` of Jazzy.
    assert offered["rt/joint_states"] == {
        "topic": "rt/joint_states",
        "type": "sensor_msgs::msg::dds_::JointState_",
        "user_data": "typehash=RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11"
        "c5882bc9179260e;",
        "reliable": True,
    }
    assert offered["rt/camera/color/image_raw"] == {
        "topic": "rt/camera/color/image_raw",
        "type": "sensor_msgs::msg::dds_::Image_",
        "user_data": "typehash=RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4"
        "588fb9582527d47;",
        "reliable": False,
    }
    assert {
        (entry["type"], entry["user_data"], entry["reliable"])
        for entry in data["subscription"]
        if entry["topic"] == "rt/grasp"
    } == {
        (
            "std_msgs::msg::dds_::Int32_",
            "typehash=RIHS01_b6578ded3c58c626cfe8d1a6fb6e04f706f97e9f03d2727c9ff4e74b1c"
            "ef0deb;",
            reliable,
        )
        for reliable in (True, False)
    }


def test_the_size_limit_has_room_for_the_largest_picture():
    store = get_typestore(Stores.ROS2_HUMBLE)

    def make(kind, *values, **fields):
        return store.types[kind](*values, **fields)

    camera = camera_topics(
        "ceiling", CameraInfo(1920, 1080, 900.0, 900.0, 960.0, 540.0)
    )
    depth = np.zeros((1080, 1920), np.float32)
    message = camera["/camera/depth/image_raw"].convert(make, 0.0, depth)
    size = len(store.serialize_cdr(message, IMAGE.type))
    assert size < largest_message([*TOPICS, *camera.values()], make)


@pytest.mark.slow
def test_a_stopped_reader_delays_nobody(bridge, peer):
    count = 500
    stamps = []

    def publish():
        for i in range(count):
            bridge.publish(JOINT_STATES, i + 1.0, [STATE, None])
            time.sleep(0.001)

    def all_arrived():
        messages = other.take("/joint_states")
        stamps.extend(message["header"]["stamp"]["sec"] for message in messages)
        return stamps[-1:] == [count]

    with (
        closing(CyclonePeer(bridge.domain)) as other,
        ThreadPoolExecutor() as threads,
    ):
        for each in (peer, other):
            subscribe(each, bridge, "/joint_states", "JointState")
        # The bridge knows both once both have received a message.
        for each in (peer, other):
            assert wait_until(
                lambda each=each: (
                    bridge.publish(JOINT_STATES, 0.0, [STATE, None])
                    or each.take("/joint_states")
                )
            )
        other.take("/joint_states")
        peer.signal(signal.SIGSTOP)
        try:
            # Cyclone's default max_blocking_time of 100 ms would add up to 50 s.
            threads.submit(publish).result(timeout=25.0)
            assert wait_until(all_arrived)
        finally:
            peer.signal(signal.SIGCONT)
    assert [stamp for stamp in stamps if stamp] == list(range(1, count + 1))


def test_a_topic_that_it_does_not_publish_has_no_subscribers(bridge):
    assert not bridge.has_subscribers("/unknown")


def test_a_closed_bridge_is_silent_and_leaves_no_thread(bridge, peer):
    subscribe(peer, bridge, "/joint_states", "JointState")
    bridge.close()
    assert not [t for t in threading.enumerate() if t.name == "ros2"]
    bridge.close()
    assert not bridge.has_subscribers("/joint_states")
    bridge.publish(JOINT_STATES, 0.0, [STATE, None])
    assert wait_until(lambda: peer.matched("/joint_states") == 0)
    assert peer.take("/joint_states") == []


def test_a_process_opens_a_domain_only_once(inbox, bridge):
    with pytest.raises(ValueError, match=f"domain {bridge.domain} is already open"):
        Ros2Bridge(inbox, [], domain=bridge.domain)
    bridge.close()
    Ros2Bridge(inbox, [], domain=bridge.domain).close()


def test_a_missing_package_comes_with_the_command_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "cyclonedds.core", None)
    monkeypatch.delitem(sys.modules, "drake_srg.robot.serve.ros2.bridge")
    with pytest.raises(ImportError, match=r"pip install .*\[ros2\]"):
        import drake_srg.robot.serve.ros2.bridge  # noqa: F401 (imported for its effect)


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)


@pytest.mark.parametrize(
    ("given", "text", "domain"),
    [(0, "", 0), (232, "", 232), (7, "42", 7), (None, "", 0), (None, "42", 42)],
)
def test_a_domain_is_that_of_the_environment_unless_given(
    monkeypatch, given, text, domain
):
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    assert domain_id(given) == domain


@pytest.mark.parametrize(
    ("given", "text"),
    [(-1, ""), (233, ""), *((None, text) for text in ("300", "-1", "one", "1.5", "²"))],
)
def test_a_domain_must_be_0_to_232(monkeypatch, given, text):
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    origin = (
        f"ROS_DOMAIN_ID: .* got {text}" if given is None else "ROS 2 domain: .* got"
    )
    with pytest.raises(ValueError, match=origin.replace(".*", "must be 0 to 232,")):
        domain_id(given)


@pytest.mark.parametrize(("interface", "domain"), [("127.0.0.1", None), ("lo", 232)])
def test_a_domain_can_be_opened_and_closed_repeatedly(interface, domain):
    domain = free_domain() if domain is None else domain
    for _ in range(2):
        with open_participant(domain, interface, "test", 2**20) as participant:
            assert participant.get_domain_id() == domain


def test_a_domain_in_use_is_not_given_to_another_test():
    assert len({free_domain() for _ in range(8)}) == 8


def test_a_cyclonedds_uri_replaces_the_interface(monkeypatch, capfd):
    monkeypatch.setenv("CYCLONEDDS_URI", "<CycloneDDS><Nonsense/></CycloneDDS>")
    domain = free_domain()
    with (
        pytest.raises(OSError, match=f"cannot open domain {domain}"),
        open_participant(domain, "127.0.0.1", "test", 2**20),
    ):
        pass
    assert "Nonsense" in capfd.readouterr().err
    interface = '<Interfaces><NetworkInterface name="lo"/></Interfaces>'
    monkeypatch.setenv("CYCLONEDDS_URI", f"<General>{interface}</General>")
    with open_participant(domain, "nothing", "test", 2**20):
        pass


STORE = with_actions(get_typestore(Stores.ROS2_HUMBLE))


@pytest.mark.parametrize("cls", dds_peer.TYPES.values(), ids=dds_peer.TYPES.keys())
def test_types_equal_those_of_the_peer(cls):
    package, kind, _, name = cls.__idl_typename__.split("::")
    made = payload_type(STORE, f"{package}/{kind}/{name.rstrip('_')}")
    # The identifier contains a hash of the whole type.
    assert made.__idl__.get_type_id() == cls.__idl__.get_type_id()


def test_every_type_of_ros_2_can_be_made():
    for message in STORE.fielddefs:
        made = payload_type(STORE, message)
        made.__idl__.populate()


@pytest.mark.slow
def test_a_subscriber_that_gets_nothing_is_told_once():
    told = []
    inbox = CommandInbox(command_topics(), Warnings(told.append))
    domain = free_domain()
    with (
        closing(Ros2Bridge(inbox, TOPICS, domain=domain)) as bridge,
        closing(CyclonePeer(domain)) as peer,
    ):
        for _ in range(2):
            peer.subscribe(IMAGE.name, "Image", True)
        assert wait_until(lambda: told)
        assert not bridge.has_subscribers(IMAGE.name)
        subscribe(peer, bridge, "/gripper/closure_commanded", "Float64")
    (line,) = told
    assert IMAGE.name in line
    assert "reliability" in line
    assert "best effort" in line
