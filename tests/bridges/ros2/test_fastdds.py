import subprocess
from pathlib import Path

import numpy as np
import pytest

from bridges.conftest import needs_debian, wait_until
from bridges.ros2.ros2_peers import Peer, command_topics, free_domain
from drake_srg.bridges.commands import CommandInbox, Warnings
from drake_srg.bridges.ros2.bridge import Ros2Bridge
from drake_srg.bridges.topics import image_message
from drake_srg.recording import ros_topics

pytestmark = pytest.mark.ros

JOINT_STATES = ros_topics.joint_states({"arm": ["a", "b"]})
IMAGE = ros_topics.Topic(
    "/camera/color/image_raw",
    "sensor_msgs/msg/Image",
    {},
    lambda make, time, pixels: image_message(make, time, "camera", "rgb8", pixels),
    sensor=True,
)


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    needs_debian("g++", "/usr/include/fastdds/dds/domain/DomainParticipant.hpp")
    program = tmp_path_factory.mktemp("fastdds") / "peer"
    source = Path(__file__).parent / "fastdds" / "peer.cpp"
    libraries = ["-lfastrtps", "-lfastcdr"]
    command = ["g++", "-std=c++17", "-o", program, source, *libraries]
    subprocess.run(command, check=True, timeout=300.0)
    return program


@pytest.fixture
def told():
    return []


@pytest.fixture
def inbox(told):
    return CommandInbox(command_topics(), Warnings(told.append))


@pytest.fixture
def bridge(program, inbox, monkeypatch):
    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)
    bridge = Ros2Bridge(inbox, [JOINT_STATES, IMAGE], domain=free_domain())
    yield bridge
    bridge.close()


@pytest.fixture
def peer(program, bridge):
    peer = Peer(program, str(bridge.domain))
    # Two readers of each command, one of them reliable; one writer of each topic.
    assert wait_until(lambda: peer.ask("matched") == "2 2 1 1", timeout=20.0)
    assert wait_until(
        lambda: all(map(bridge.has_subscribers, (JOINT_STATES.name, IMAGE.name)))
    )
    yield peer
    peer.close()


def test_fast_dds_commands(peer, inbox, told):
    peer.ask("grasp 42")
    peer.ask("kuka 0.1 0.2 0.3 0.4 0.5 0.6 0.7")
    assert wait_until(lambda: inbox.received == 2)
    taken = inbox.take()
    assert taken["/grasp"].tolist() == [42.0]
    assert taken["/kuka"].tolist() == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]
    assert told == []


def test_fast_dds_reads_joint_states(bridge, peer):
    bridge.publish(JOINT_STATES, 1.5, [np.array([0.25, 0.5, -1.0, 2.0]), None])
    answer = wait_until(lambda: (got := peer.ask("joint_states")) != "0" and got)
    assert answer == "1 1 500000000 a b 0.25 0.5 -1 2 nan nan"


def test_fast_dds_reads_images(bridge, peer):
    pixels = np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8)

    def look():
        # More than once: Fast DDS reads into a buffer of the system's default size,
        # 208 KiB, which an image of 900 KiB overflows unless it is quick.
        bridge.publish(IMAGE, 0.0, [pixels])
        return wait_until(lambda: (got := peer.ask("image")) != "0" and got, 0.1)

    answer = wait_until(look, timeout=20.0)
    values = pixels.reshape(-1).astype(int)
    total = (values * (np.arange(values.size) % 251 + 1)).sum()
    assert answer.partition(" ")[2] == f"camera 480 640 rgb8 1920 921600 {total}"


def test_malformed_commands_are_refused_with_one_warning(peer, inbox, told):
    for payload in (
        "00010000",  # nothing: DDS itself drops it
        "000100000500000006000000",  # four bytes too many
        "0007000005000000",  # XCDR2, which it does not offer
        "000b00000500000005000000",  # the same, of a mutable type
    ):
        peer.ask("grasp 1")
        peer.ask(f"raw {payload}")
        peer.ask("grasp 2")
        assert wait_until(lambda: inbox.take().get("/grasp") == [2.0])
    assert told == ["/grasp: is no std_msgs/msg/Int32; the last good command holds"]


def test_the_other_byte_order_is_read(peer, inbox):
    peer.ask("raw 0000000000000005")
    assert wait_until(lambda: inbox.received == 1)
    assert inbox.take()["/grasp"].tolist() == [5.0]
