"""Close and open the gripper of `drake-srg serve kitchen --ros2`, and print its joints.

The script talks to ROS 2 through DDS and needs only `pip install cyclonedds`. The same
with ROS 2 itself, after `export ROS_LOCALHOST_ONLY=1`:

    ros2 topic pub --once /grasp std_msgs/msg/Int32 '{data: 100}'
    ros2 topic echo /joint_states
"""

import os
import time
from dataclasses import dataclass

from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

# By default, the server is reachable from this machine only.
LOOPBACK = '<Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>'


@dataclass
class Int32(IdlStruct, typename="std_msgs::msg::dds_::Int32_"):
    """std_msgs/msg/Int32."""

    data: int32


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    """builtin_interfaces/msg/Time."""

    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    """std_msgs/msg/Header."""

    stamp: Time
    frame_id: str


@dataclass
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    """sensor_msgs/msg/JointState [rad, rad/s, N m]."""

    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


def main() -> None:
    """Close and open the gripper, 1.5 s each."""
    domain_id = int(os.environ.get("ROS_DOMAIN_ID") or 0)
    domain = Domain(domain_id, f"<General>{LOOPBACK}</General>")  # noqa: F841 (lives as long as this)
    participant = DomainParticipant(domain_id)
    grasp = DataWriter(participant, Topic(participant, "rt/grasp", Int32))
    states = DataReader(participant, Topic(participant, "rt/joint_states", JointState))

    print("waiting for drake-srg serve ...")
    while not (grasp.get_matched_subscriptions() and states.get_matched_publications()):
        time.sleep(0.1)
    for percent in (100, 0):  # closed, open
        print(f"grasp {percent}")
        grasp.write(Int32(percent))
        for _ in range(3):
            time.sleep(0.5)
            for state in states.take(N=1000)[-1:]:
                joints = zip(state.name, state.position, strict=True)
                fingers = [(name, q) for name, q in joints if "base" in name]
                print("  " + ", ".join(f"{name} {q:.2f} rad" for name, q in fingers))


if __name__ == "__main__":
    main()
