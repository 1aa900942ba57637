"""A real rospy node under remote control, run by /usr/bin/python3.

It reads orders as lines of JSON: ["subscribe", TOPIC, TYPE] and ["publish", TOPIC,
TYPE, VALUES], which publishes one message per value. It writes each message received
as a line [TOPIC, MESSAGE].
"""

import json
import math
import sys
import threading
import time

import rospy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import Bool, Float64MultiArray, Int32, String

TYPES = {
    t._type: t
    for t in (
        Bool,
        CameraInfo,
        Clock,
        Float64MultiArray,
        Image,
        Int32,
        JointState,
        String,
    )
}
publishers = {}
printing = threading.Lock()


def plain(value):
    """Convert a message to values that JSON can represent."""
    if hasattr(value, "__slots__"):
        return {name: plain(getattr(value, name)) for name in value.__slots__}
    if isinstance(value, bytes):
        return [len(value), sum(value)]
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def show(message, topic):
    line = json.dumps([topic, plain(message)])
    with printing:
        print(line, flush=True)


def publish(topic, kind, values):
    if topic not in publishers:
        publishers[topic] = rospy.Publisher(topic, TYPES[kind], queue_size=1000)
    end = time.time() + 5.0
    while not publishers[topic].get_num_connections() and time.time() < end:
        time.sleep(0.01)
    for value in values:
        publishers[topic].publish(TYPES[kind](data=value))


rospy.init_node("client", anonymous=True, disable_signals=True)
print(json.dumps(["ready", None]), flush=True)
for line in sys.stdin:
    command, topic, kind, *rest = json.loads(line)
    if command == "subscribe":
        rospy.Subscriber(topic, TYPES[kind], show, callback_args=topic)
    else:
        publish(topic, kind, *rest)
