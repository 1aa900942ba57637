"""A peer of the ROS 2 bridge that runs as a process: `dds_peer.py DOMAIN`.

It does not use the package: its types are written by hand, and Cyclone DDS serialises
them. It reads orders as lines of JSON, [name, argument...], and answers each with a
line of JSON.
"""

import dataclasses as dc
import json
import sys
import time

from cyclonedds.builtin import (
    BuiltinDataReader,
    BuiltinTopicDcpsParticipant,
    BuiltinTopicDcpsPublication,
    BuiltinTopicDcpsSubscription,
)
from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float64, int32, sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic


@dc.dataclass
class Int32(IdlStruct, typename="std_msgs::msg::dds_::Int32_"):
    data: int32


@dc.dataclass
class Bool(IdlStruct, typename="std_msgs::msg::dds_::Bool_"):
    data: bool


@dc.dataclass
class Float64(IdlStruct, typename="std_msgs::msg::dds_::Float64_"):
    data: float64


@dc.dataclass
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str


@dc.dataclass
class MultiArrayDimension(
    IdlStruct, typename="std_msgs::msg::dds_::MultiArrayDimension_"
):
    label: str
    size: uint32
    stride: uint32


@dc.dataclass
class MultiArrayLayout(IdlStruct, typename="std_msgs::msg::dds_::MultiArrayLayout_"):
    dim: sequence[MultiArrayDimension]
    data_offset: uint32


@dc.dataclass
class Float64MultiArray(IdlStruct, typename="std_msgs::msg::dds_::Float64MultiArray_"):
    layout: MultiArrayLayout
    data: sequence[float64]


@dc.dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dc.dataclass
class Clock(IdlStruct, typename="rosgraph_msgs::msg::dds_::Clock_"):
    clock: Time


@dc.dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dc.dataclass
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dc.dataclass
class Image(IdlStruct, typename="sensor_msgs::msg::dds_::Image_"):
    header: Header
    height: uint32
    width: uint32
    encoding: str
    is_bigendian: uint8
    step: uint32
    data: sequence[uint8]


@dc.dataclass
class RegionOfInterest(IdlStruct, typename="sensor_msgs::msg::dds_::RegionOfInterest_"):
    x_offset: uint32
    y_offset: uint32
    height: uint32
    width: uint32
    do_rectify: bool


@dc.dataclass
class CameraInfo(IdlStruct, typename="sensor_msgs::msg::dds_::CameraInfo_"):
    header: Header
    height: uint32
    width: uint32
    distortion_model: str
    d: sequence[float64]
    k: array[float64, 9]
    r: array[float64, 9]
    p: array[float64, 12]
    binning_x: uint32
    binning_y: uint32
    roi: RegionOfInterest


MESSAGES = (Int32, Bool, Float64, String, Float64MultiArray, Clock, JointState, Image)
TYPES = {cls.__name__: cls for cls in (*MESSAGES, CameraInfo)}
# With a lease of one second, others soon notice when this process has vanished.
CONFIGURATION = """
<CycloneDDS><Domain>
  <General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces></General>
  <Discovery><LeaseDuration>1s</LeaseDuration><Peers AddLocalhost="true"/></Discovery>
</Domain></CycloneDDS>
"""
ANY = SampleState.Any | ViewState.Any | InstanceState.Any


def message(kind, data):
    if kind != "Float64MultiArray":
        return TYPES[kind](data)
    return Float64MultiArray(MultiArrayLayout([], 0), data)


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
        topic = Topic(self.participant, f"rt{name}", TYPES[kind])
        self.readers[name] = DataReader(self.participant, topic, qos(reliable, 1000))

    def matched(self, name):
        return self.readers[name].get_subscription_matched_status().current_count

    def take(self, name):
        samples = self.readers[name].take(1000)
        return [dc.asdict(s) for s in samples if dc.is_dataclass(s)]

    def advertise(self, name, kind, reliable=True):
        topic = Topic(self.participant, f"rt{name}", TYPES[kind])
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
            writer.write(message(kind, value))

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
        print(json.dumps(getattr(peer, order)(*arguments)), flush=True)


if __name__ == "__main__":
    main()
