"""A peer of the ROS 2 bridge that runs as a process: `dds_peer.py DOMAIN`.

It does not use the package: it makes its own types of rosbags' definitions and of those
below, and Cyclone DDS serialises them. It reads orders as lines of JSON, [name,
argument...], and answers each with a line of JSON.
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
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

# Of the action FollowJointTrajectory, by field. Each message of a service begins with
# the header of rmw_cyclonedds_cpp.
FOLLOW = "control_msgs/action/FollowJointTrajectory"
CANCEL = "action_msgs/srv/CancelGoal"
CALL = {"client": "uint64", "number": "int64"}
LIMITS = dict.fromkeys(("position", "velocity", "acceleration"), "float64")
TOLERANCES = "control_msgs/JointTolerance[]"
COMPONENTS = "control_msgs/JointComponentTolerance[]"
DEFINITIONS = {
    "control_msgs/msg/JointTolerance": {"name": "string", **LIMITS},
    "control_msgs/msg/JointComponentTolerance": {
        "joint_name": "string",
        "component": "uint16",
        **LIMITS,
    },
    f"{FOLLOW}_SendGoal_Request": {
        **CALL,
        "goal_id": "unique_identifier_msgs/UUID",
        "trajectory": "trajectory_msgs/JointTrajectory",
        "multi_dof_trajectory": "trajectory_msgs/MultiDOFJointTrajectory",
        "path_tolerance": TOLERANCES,
        "component_path_tolerance": COMPONENTS,
        "goal_tolerance": TOLERANCES,
        "component_goal_tolerance": COMPONENTS,
        "goal_time_tolerance": "builtin_interfaces/Duration",
    },
    f"{FOLLOW}_SendGoal_Response": {
        **CALL,
        "accepted": "bool",
        "stamp": "builtin_interfaces/Time",
    },
    f"{FOLLOW}_GetResult_Request": {**CALL, "goal_id": "unique_identifier_msgs/UUID"},
    f"{FOLLOW}_GetResult_Response": {
        **CALL,
        "status": "int8",
        "error_code": "int32",
        "error_string": "string",
    },
    f"{CANCEL}_Request": {**CALL, "goal_info": "action_msgs/GoalInfo"},
    f"{CANCEL}_Response": {
        **CALL,
        "return_code": "int8",
        "goals_canceling": "action_msgs/GoalInfo[]",
    },
}
STORE = get_typestore(Stores.ROS2_HUMBLE)
for name, definition in DEFINITIONS.items():
    text = "\n".join(f"{kind} {field}" for field, kind in definition.items())
    (fields,) = get_types_from_msg(text, name).values()
    STORE.register({name: fields})


def struct(name):
    """Return the type of a message, such as "std_msgs/msg/Int32"."""
    package, kind, short = name.split("/")
    members = {field: member(*what) for field, what in STORE.fielddefs[name][1]}
    return idl.make_idl_struct(short, f"{package}::{kind}::dds_::{short}_", members)


def member(kind, what):
    """Return the type of a message's field."""
    if kind == Nodetype.NAME:
        return struct(what)
    of, size = what
    if kind == Nodetype.BASE:
        plain = {"bool": bool, "string": str, "byte": idl.types.uint8}
        return plain.get(of) or getattr(idl.types, of)
    if kind == Nodetype.ARRAY:
        return idl.types.array[member(*of), size]
    return idl.types.sequence[member(*of)]


STANDARD = (
    *("Bool", "Float64", "Float64MultiArray", "Int32", "String"),
    *("JointState", "Image", "CameraInfo", "Clock"),
)
MESSAGES = {message.rpartition("/")[2]: message for message in STORE.fielddefs}
CALLS = [name for name in DEFINITIONS if "/msg/" not in name]
TYPES = {name: struct(MESSAGES[name]) for name in STANDARD}
TYPES |= {name.rpartition("/")[2]: struct(name) for name in CALLS}

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
    if cls is TYPES["Float64MultiArray"]:
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
        topic = Topic(self.participant, "rt/grasp", TYPES["Int32"])
        writer = DataWriter(self.participant, topic, qos(True, 10))
        while writer.get_publication_matched_status().current_count < 2:
            time.sleep(0.001)  # the bridge has two readers per topic
        writer.write(TYPES["Int32"](0))
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
