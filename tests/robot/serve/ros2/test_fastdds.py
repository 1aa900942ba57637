import contextlib
import subprocess
from pathlib import Path

import numpy as np
import pytest
from helpers import needs_debian

from drake_srg.recording import rosbag
from robot.serve.ros2.peers import Peer
from robot.serve.waiting import wait_until

pytestmark = [pytest.mark.slow, pytest.mark.ros]

JOINT_STATES = rosbag.joint_states({"arm": ["a", "b"]})
IMAGE = rosbag.Topic(
    "/camera/color/image_raw",
    "sensor_msgs/msg/Image",
    {},
    lambda make, t, pixels: rosbag.image_message(make, t, "camera", "rgb8", pixels),
    sensor=True,
)


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    needs_debian("g++", "/usr/include/fastdds/dds/domain/DomainParticipant.hpp")
    program = tmp_path_factory.mktemp("fastdds") / "peer"
    source = Path(__file__).parent / "fastdds" / "peer.cpp"
    old = Path("/usr/include/fastrtps").is_dir()  # Fast DDS 2
    libraries = ["-lfastrtps" if old else "-lfastdds", "-lfastcdr"]
    command = ["g++", "-std=c++17", "-o", program, source, *libraries]
    subprocess.run(command, check=True, timeout=300.0)
    return program


@pytest.fixture
def topics():
    return [JOINT_STATES, IMAGE]


@pytest.fixture
def peer(program, bridge, topics):
    with contextlib.closing(Peer(program, str(bridge.domain))) as peer:
        # Two readers of each command (reliable, best effort), one writer of each topic.
        assert wait_until(lambda: peer.ask("matched") == "2 2 1 1", timeout=20.0)
        assert wait_until(lambda: all(bridge.has_subscribers(t.name) for t in topics))
        yield peer


def test_fast_dds_sends_commands(peer, inbox, told):
    peer.ask("grasp 42")
    peer.ask("kuka 0.1 0.2 0.3 0.4 0.5 0.6 0.7")
    assert wait_until(lambda: inbox.received == 2)
    taken = inbox.take()
    assert taken["/grasp"].tolist() == [42.0]
    assert taken["/kuka"].tolist() == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]
    assert told == []


def test_fast_dds_receives_joint_states(bridge, peer):
    bridge.publish(JOINT_STATES, 1.5, [np.array([0.25, 0.5, -1.0, 2.0]), None])
    answer = wait_until(lambda: (got := peer.ask("joint_states")) != "0" and got)
    assert answer == "1 1 500000000 a b 0.25 0.5 -1 2 nan nan"


def test_fast_dds_receives_images(bridge, peer):
    pixels = np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8)

    def look():
        # Repeatedly: Fast DDS has the system's default receive buffer of 208 KiB, which
        # an image of 900 KiB overflows unless Fast DDS reads fast enough.
        bridge.publish(IMAGE, 0.0, [pixels])
        return wait_until(lambda: (got := peer.ask("image")) != "0" and got, 0.1)

    answer = wait_until(look, timeout=20.0)
    values = pixels.reshape(-1).astype(int)
    total = (values * (np.arange(values.size) % 251 + 1)).sum()
    assert answer.partition(" ")[2] == f"camera 480 640 rgb8 1920 921600 {total}"


def test_malformed_commands_are_refused_with_one_warning(peer, inbox, told):
    for payload in (
        "00010000",  # no data: DDS itself drops it
        "000100000500000006000000",  # four bytes too many
        "0007000005000000",  # XCDR2, which the bridge does not support
        "000b00000500000005000000",  # XCDR2 of a mutable type
    ):
        peer.ask("grasp 1")
        peer.ask(f"raw {payload}")
        peer.ask("grasp 2")
        assert wait_until(lambda: inbox.take().get("/grasp") == [2.0])
    (text,) = told
    assert text.startswith("/grasp: must be a std_msgs/msg/Int32: ")
    assert text.endswith("; the last good command holds")


def test_big_endian_data_is_read(peer, inbox):
    peer.ask("raw 0000000000000005")
    assert wait_until(lambda: inbox.received == 1)
    assert inbox.take()["/grasp"].tolist() == [5.0]
