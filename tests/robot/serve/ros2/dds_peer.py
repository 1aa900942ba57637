"""A peer of the ROS 2 bridge that runs as a process: `dds_peer.py DOMAIN`.

It does not use the package: its types are written by hand, and Cyclone DDS serialises
them. It reads orders as lines of JSON, [name, argument...], and answers each with a
line of JSON.
"""

import dataclasses as dc
import json
import sys
import time

from cyclonedds import idl
from cyclonedds.builtin import (
    BuiltinDataReader,
    BuiltinTopicDcpsParticipant,
    BuiltinTopicDcpsPublication,
    BuiltinTopicDcpsSubscription,
)
from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl.types import (
    array,
    float64,
    int8,
    int32,
    int64,
    sequence,
    uint8,
    uint16,
    uint32,
    uint64,
)
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic


def struct(name, /, **members):
    """Return a type of ROS, such as "std_msgs/msg/Int32", with these members."""
    package, kind, short = name.split("/")
    return idl.make_idl_struct(short, f"{package}::{kind}::dds_::{short}_", members)


Int32 = struct("std_msgs/msg/Int32", data=int32)
Bool = struct("std_msgs/msg/Bool", data=bool)
Float64 = struct("std_msgs/msg/Float64", data=float64)
String = struct("std_msgs/msg/String", data=str)
Dimension = struct(
    "std_msgs/msg/MultiArrayDimension", label=str, size=uint32, stride=uint32
)
Layout = struct(
    "std_msgs/msg/MultiArrayLayout", dim=sequence[Dimension], data_offset=uint32
)
Float64MultiArray = struct(
    "std_msgs/msg/Float64MultiArray", layout=Layout, data=sequence[float64]
)
Time = struct("builtin_interfaces/msg/Time", sec=int32, nanosec=uint32)
Duration = struct("builtin_interfaces/msg/Duration", sec=int32, nanosec=uint32)
Clock = struct("rosgraph_msgs/msg/Clock", clock=Time)
Header = struct("std_msgs/msg/Header", stamp=Time, frame_id=str)
JointState = struct(
    "sensor_msgs/msg/JointState",
    header=Header,
    name=sequence[str],
    position=sequence[float64],
    velocity=sequence[float64],
    effort=sequence[float64],
)
Image = struct(
    "sensor_msgs/msg/Image",
    header=Header,
    height=uint32,
    width=uint32,
    encoding=str,
    is_bigendian=uint8,
    step=uint32,
    data=sequence[uint8],
)
RegionOfInterest = struct(
    "sensor_msgs/msg/RegionOfInterest",
    **dict.fromkeys(("x_offset", "y_offset", "height", "width"), uint32),
    do_rectify=bool,
)
CameraInfo = struct(
    "sensor_msgs/msg/CameraInfo",
    header=Header,
    height=uint32,
    width=uint32,
    distortion_model=str,
    d=sequence[float64],
    k=array[float64, 9],
    r=array[float64, 9],
    p=array[float64, 12],
    binning_x=uint32,
    binning_y=uint32,
    roi=RegionOfInterest,
)

# Of the action FollowJointTrajectory.
Uuid = struct("unique_identifier_msgs/msg/UUID", uuid=array[uint8, 16])
GoalInfo = struct("action_msgs/msg/GoalInfo", goal_id=Uuid, stamp=Time)
Vector3 = struct("geometry_msgs/msg/Vector3", **dict.fromkeys("xyz", float64))
Quaternion = struct("geometry_msgs/msg/Quaternion", **dict.fromkeys("xyzw", float64))
Transform = struct(
    "geometry_msgs/msg/Transform", translation=Vector3, rotation=Quaternion
)
Twist = struct("geometry_msgs/msg/Twist", linear=Vector3, angular=Vector3)
Point = struct(
    "trajectory_msgs/msg/JointTrajectoryPoint",
    positions=sequence[float64],
    velocities=sequence[float64],
    accelerations=sequence[float64],
    effort=sequence[float64],
    time_from_start=Duration,
)
MultiPoint = struct(
    "trajectory_msgs/msg/MultiDOFJointTrajectoryPoint",
    transforms=sequence[Transform],
    velocities=sequence[Twist],
    accelerations=sequence[Twist],
    time_from_start=Duration,
)
Trajectory, MultiTrajectory = (
    struct(
        f"trajectory_msgs/msg/{name}",
        header=Header,
        joint_names=sequence[str],
        points=sequence[point],
    )
    for name, point in (
        ("JointTrajectory", Point),
        ("MultiDOFJointTrajectory", MultiPoint),
    )
)
_LIMITS = dict.fromkeys(("position", "velocity", "acceleration"), float64)
Tolerance = struct("control_msgs/msg/JointTolerance", name=str, **_LIMITS)
Component = struct(
    "control_msgs/msg/JointComponentTolerance",
    joint_name=str,
    component=uint16,
    **_LIMITS,
)
_FOLLOW = "control_msgs/action/FollowJointTrajectory"
# Each message of a service begins with the header of rmw_cyclonedds_cpp.
_CALL = {"client": uint64, "number": int64}
CALLS = (
    struct(
        f"{_FOLLOW}_SendGoal_Request",
        **_CALL,
        goal_id=Uuid,
        trajectory=Trajectory,
        multi_dof_trajectory=MultiTrajectory,
        path_tolerance=sequence[Tolerance],
        component_path_tolerance=sequence[Component],
        goal_tolerance=sequence[Tolerance],
        component_goal_tolerance=sequence[Component],
        goal_time_tolerance=Duration,
    ),
    struct(f"{_FOLLOW}_SendGoal_Response", **_CALL, accepted=bool, stamp=Time),
    struct(f"{_FOLLOW}_GetResult_Request", **_CALL, goal_id=Uuid),
    struct(
        f"{_FOLLOW}_GetResult_Response",
        **_CALL,
        status=int8,
        error_code=int32,
        error_string=str,
    ),
    struct("action_msgs/srv/CancelGoal_Request", **_CALL, goal_info=GoalInfo),
    struct(
        "action_msgs/srv/CancelGoal_Response",
        **_CALL,
        return_code=int8,
        goals_canceling=sequence[GoalInfo],
    ),
)
MESSAGES = (Int32, Bool, Float64, String, Float64MultiArray, Clock, JointState, Image)
TYPES = {cls.__name__: cls for cls in (*MESSAGES, CameraInfo, *CALLS)}

# With a lease of one second, others soon notice when this process has vanished.
CONFIGURATION = """
<CycloneDDS><Domain>
  <General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces></General>
  <Discovery><LeaseDuration>1s</LeaseDuration><Peers AddLocalhost="true"/></Discovery>
</Domain></CycloneDDS>
"""
ANY = SampleState.Any | ViewState.Any | InstanceState.Any


def message(cls, data):
    """Return a message of the value of its only field, or of fields by name."""
    if cls is Float64MultiArray:
        data = {"layout": {"dim": [], "data_offset": 0}, "data": data}
    if not isinstance(data, dict):
        return cls(data)
    return cls(
        **{
            field.name: message(field.type, data[field.name])
            if dc.is_dataclass(field.type)
            else data[field.name]
            for field in dc.fields(cls)
        }
    )


def named(topic):
    """Return the name on DDS of a topic, which has a slash, or of a service's."""
    return f"rt{topic}" if topic.startswith("/") else topic


def qos(reliable, depth):
    return Qos(
        Policy.Reliability.Reliable(max_blocking_time=10**9)
        if reliable
        else Policy.Reliability.BestEffort,
        Policy.History.KeepLast(depth),
        Policy.DataRepresentation(
            use_cdrv0_representation=True, use_xcdrv2_representation=False
        ),
    )


class Peer:
    def __init__(self, domain):
        self.domain = Domain(domain, CONFIGURATION)
        self.participant = DomainParticipant(domain)
        self.readers, self.writers = {}, {}

    def subscribe(self, name, kind, reliable=True):
        topic = Topic(self.participant, named(name), TYPES[kind])
        self.readers[name] = DataReader(self.participant, topic, qos(reliable, 1000))

    def matched(self, name):
        return self.readers[name].get_subscription_matched_status().current_count

    def take(self, name):
        samples = self.readers[name].take(1000)
        return [dc.asdict(s) for s in samples if dc.is_dataclass(s)]

    def advertise(self, name, kind, reliable=True):
        topic = Topic(self.participant, named(name), TYPES[kind])
        # A whole burst, so that what is lost on the way can be sent again.
        writer = DataWriter(self.participant, topic, qos(reliable, 100))
        self.writers[name] = (writer, kind)

    def subscribers(self, name):
        return self.writers[name][0].get_publication_matched_status().current_count

    def introduce(self):
        """Wait until the subscriber of /grasp knows all writers.

        Writers are announced in order. So this adds one more and waits until its
        message, a 0, has been confirmed.
        """
        topic = Topic(self.participant, "rt/grasp", Int32)
        writer = DataWriter(self.participant, topic, qos(True, 10))
        while writer.get_publication_matched_status().current_count < 2:
            time.sleep(0.001)  # the bridge has two readers per topic
        writer.write(Int32(0))
        writer.wait_for_acks(10 * 10**9)

    def publish(self, name, *values):
        writer, kind = self.writers[name]
        for value in values:
            writer.write(message(TYPES[kind], value))

    def burst(self, count, values):
        """Publish `count` messages a topic at once; `values` are the last ones."""
        for i in range(count):
            for name, last in values.items():
                data = [0.0] * len(last) if isinstance(last, list) else type(last)()
                self.publish(name, last if i == count - 1 else data)

    def user_data(self):
        """Return the announcements of others: {kind: [{topic, type, ...}]}."""
        told = {}
        for kind, builtin in (
            ("participant", BuiltinTopicDcpsParticipant),
            ("publication", BuiltinTopicDcpsPublication),
            ("subscription", BuiltinTopicDcpsSubscription),
        ):
            reader = BuiltinDataReader(self.participant, builtin)
            told[kind] = [
                {
                    "topic": getattr(sample, "topic_name", None),
                    "type": getattr(sample, "type_name", None),
                    "user_data": sample.qos[Policy.Userdata].data.decode(),
                    "reliable": sample.qos[Policy.Reliability]
                    != Policy.Reliability.BestEffort,
                }
                for sample in reader.take(1000, ReadCondition(reader, ANY))
                if sample.qos is not None and Policy.Userdata in sample.qos
            ]
        return told


def main():
    peer = Peer(int(sys.argv[1]))
    print(json.dumps("ready"), flush=True)
    for line in sys.stdin:
        order, *arguments = json.loads(line)
        answer = getattr(peer, order)(*arguments)
        print(json.dumps(answer, default=list), flush=True)  # arrays of uint8 are bytes


if __name__ == "__main__":
    main()
