"""Our node together with the real programs of ROS 1."""

import contextlib
import threading

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo
from rosbags.typesys import Stores, get_typestore

from drake_srg.recording import rosbag
from drake_srg.robot.serve import pictures as camera
from drake_srg.robot.serve.ros1.bridge import Ros1Bridge
from drake_srg.types import Blob
from robot.serve.ros1.peers import taken
from robot.serve.ros1.programs import RospyClient
from robot.serve.waiting import wait_until

pytestmark = [pytest.mark.slow, pytest.mark.ros]

PIXELS = (np.arange(480 * 640 * 3) % 251).astype(np.uint8).reshape(480, 640, 3)
INTRINSICS = CameraInfo(640, 480, 600.0, 601.0, 320.5, 240.5)
CAMERA = camera.camera_topics("ceiling", INTRINSICS)
BLOB = Blob("soup_can", "ceiling", (320, 240), RigidTransform(), 1.0)
# Every topic that is published, with the values of its ports.
PUBLISHED = {
    "/clock": (rosbag.clock(), []),
    "/joint_states": (
        rosbag.joint_states({"arm": ["a1", "a2"]}),
        [np.array([1.0, 2.0, 3.0, 4.0]), None],
    ),
    "/gripper/proximity": (
        rosbag.float64_array("/gripper/proximity", "p", 2),
        [np.array([0.01, np.inf])],
    ),
    camera.COLOR: (CAMERA[camera.COLOR], [PIXELS]),
    camera.DEPTH: (CAMERA[camera.DEPTH], [np.full((480, 640), 0.5, np.float32)]),
    camera.CAMERA_INFO: (CAMERA[camera.CAMERA_INFO], []),
    camera.BLOBS: (CAMERA[camera.BLOBS], [[BLOB]]),
}


@pytest.fixture(scope="module")
def client(roscore):
    with contextlib.closing(RospyClient(roscore)) as client:
        yield client


@pytest.fixture
def bridge(roscore, inbox):
    published = [topic for topic, _ in PUBLISHED.values()]
    with contextlib.closing(Ros1Bridge(inbox, published, master=roscore.uri)) as bridge:
        assert wait_until(lambda: "waiting" not in bridge.status)
        yield bridge


@contextlib.contextmanager
def publishing(bridge, *names):
    """Publish topics in a thread while time passes."""
    stop = threading.Event()

    def run():
        time = 0.0
        while not stop.wait(0.02):
            time += 0.5
            for name in names or PUBLISHED:
                topic, values = PUBLISHED[name]
                bridge.publish(topic, time, values)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("topic", "kind", "value", "name", "commanded"),
    [
        ("/grasp", "std_msgs/Int32", 42, "closure", [0.42]),
        ("/startgrasp", "std_msgs/Bool", False, "hold", [True]),
        ("/kuka", "std_msgs/Float64MultiArray", [1.0, -2.0], "arm", [1.0, -2.0]),
    ],
)
def test_rospy_sends_commands(
    bridge, client, inbox, topic, kind, value, name, commanded
):
    client.publish(topic, kind, value)
    assert taken(inbox, name) == commanded


def test_rospy_receives_every_topic(bridge, client):
    for name, (topic, _) in PUBLISHED.items():
        client.subscribe(name, topic.type.replace("/msg/", "/"))
    with publishing(bridge):
        got = {name: client.receive(name) for name in PUBLISHED}
    assert got["/clock"]["clock"]["nsecs"] in (0, 500_000_000)
    joints = got["/joint_states"]
    assert joints["name"] == ["a1", "a2"]
    assert (joints["position"], joints["velocity"]) == ([1.0, 2.0], [3.0, 4.0])
    assert joints["effort"] == ["nan", "nan"]
    assert got["/gripper/proximity"]["data"] == [0.01, "inf"]
    color, depth = got[camera.COLOR], got[camera.DEPTH]
    assert (color["height"], color["width"], color["step"]) == (480, 640, 1920)
    assert (color["encoding"], color["header"]["frame_id"]) == (
        "rgb8",
        "camera_ceiling",
    )
    assert color["data"] == [PIXELS.size, PIXELS.sum()]
    assert (depth["encoding"], depth["data"][0]) == ("32FC1", 480 * 640 * 4)
    info = got[camera.CAMERA_INFO]
    assert (info["K"][0], info["K"][4], info["K"][8]) == (600.0, 601.0, 1.0)
    assert '"soup_can"' in got[camera.BLOBS]["data"]


@pytest.mark.slow
def test_ros_tools_see_the_node(bridge, roscore, inbox):
    # All at once, because each takes a second to start. (hz runs until it is stopped.)
    tools = {
        ("rostopic", "list"): "/gripper/proximity\n",
        ("rostopic", "type", "/grasp"): "std_msgs/Int32",
        ("rostopic", "info", "/joint_states"): "* /drake_srg (http://127.0.0.1:",
        ("rostopic", "echo", "-n", "1", "/joint_states"): "position: [1.0, 2.0]",
        ("rostopic", "hz", "/clock"): "average rate: ",
        ("rostopic", "pub", "-1", "/grasp", "std_msgs/Int32", "17"): "publishing",
        ("rosnode", "info", "/drake_srg"): "* /camera/color/image_raw [sensor_msgs/Im",
        ("rosnode", "ping", "-c", "1", "/drake_srg"): "xmlrpc reply from",
    }
    printed = {}

    def run(command):
        until = tools[command] if "hz" in command else None
        printed[command] = roscore.run(*command, until=until)

    with publishing(bridge, "/clock", "/joint_states"):
        threads = [threading.Thread(target=run, args=(c,)) for c in tools]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    for command, words in tools.items():
        assert words in printed[command], printed[command]
    assert taken(inbox, "closure") == [0.17]


def test_rosnode_kill_shuts_the_node_down(bridge, roscore):
    assert "killed" in roscore.run("rosnode", "kill", "/drake_srg")
    assert wait_until(lambda: bridge.status == "ROS 1 shut down")
    assert wait_until(lambda: "/drake_srg" not in roscore.run("rosnode", "list"))


def test_roscpp_receives_messages(bridge, roscore, tmp_path):
    # Rosbag's recorder is a roscpp node that takes any type.
    bag = tmp_path / "out.bag"
    recorder = "/usr/lib/rosbag/record"
    with publishing(bridge, "/joint_states"):
        roscore.run(recorder, "--limit=3", f"--output-name={bag}", "/joint_states")
    from rosbags.rosbag1 import Reader

    with Reader(bag) as reader:
        messages = list(reader.messages())
    assert len(messages) == 3
    connection, _, data = messages[-1]
    assert connection.topic == "/joint_states"
    store = get_typestore(Stores.ROS1_NOETIC)
    message = store.deserialize_ros1(data, connection.msgtype)
    assert message.velocity.tolist() == [3.0, 4.0]
