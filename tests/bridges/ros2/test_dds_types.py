import pytest
from rosbags.typesys import Stores, get_typestore

from bridges.ros2 import dds_peer
from drake_srg.bridges.ros2.dds_types import payload_type, topic_name, type_name

STORE = get_typestore(Stores.ROS2_HUMBLE)


@pytest.mark.parametrize(
    "message, name",
    [
        ("std_msgs/msg/Int32", "std_msgs::msg::dds_::Int32_"),
        ("rosgraph_msgs/msg/Clock", "rosgraph_msgs::msg::dds_::Clock_"),
        ("action_msgs/srv/Cancel_Request", "action_msgs::srv::dds_::Cancel_Request_"),
    ],
)
def test_types_have_ros_2_s_names(message, name):
    assert type_name(message) == name


def test_names_without_a_slash_are_those_of_dds():
    assert topic_name("/grasp") == "rt/grasp"
    assert topic_name("rq/addRequest") == "rq/addRequest"


@pytest.mark.parametrize("cls", dds_peer.TYPES.values(), ids=dds_peer.TYPES.keys())
def test_types_equal_those_written_by_hand(cls):
    package, _, _, name = cls.__idl_typename__.split("::")
    made = payload_type(STORE, f"{package}/msg/{name.rstrip('_')}")
    # The identifier contains a hash of the whole type.
    assert made.__idl__.get_type_id() == cls.__idl__.get_type_id()


def test_every_type_of_ros_2_can_be_made():
    for message in STORE.fielddefs:
        made = payload_type(STORE, message)
        made.__idl__.populate()


def test_a_sample_serialises_to_its_bytes():
    sample = payload_type(STORE, "std_msgs/msg/Int32")(b"data")
    assert sample.cdr == sample.serialize(use_version_2=False) == b"data"
    assert type(sample).deserialize(b"other").cdr == b"other"
