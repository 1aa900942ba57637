#!/usr/bin/python3
"""The SRG thesis's kitchen demonstration, as a ROS 1 client of robot or simulation.

Start a roscore and `drake-srg serve thesis_kitchen --ros1`, then run this script with
the Python that has rospy (on Debian: apt install python3-rospy python3-std-msgs):

    /usr/bin/python3 examples/ros1_kitchen_client.py

It sends the thesis's messages one after the other without feedback, and does not use
Drake. Like the thesis, it keeps real time. If the simulation is slower than that, let
the script follow simulated time:

    rosparam set use_sim_time true
"""

import argparse
import contextlib
import math
import time

# The messages. "kuka": positions of the seven joints [degrees], sent `count` times on
# /kuka. "grasp": percent closed on /grasp, floor(i / 10) for i from first to last.
ROUTINES = {
    "startpos": [{"kuka": [0, 0, 0, 0, 0, 0, 0], "count": 500}],
    "movetocup": [
        {"kuka": [5, -71, 0, 110, 0, 90, 0], "count": 300},
        {"kuka": [5, -75, 0, 85, 0, 70, 0], "count": 100},
        {"kuka": [5, -78, 0, 80, 0, 66, 0], "count": 200},
    ],
    "grip": [{"grasp": [0, 1000]}],
    "lift": [{"kuka": [3, -40, 0, 70, 0, -20, 0], "count": 100}],
    "placeposition": [{"kuka": [70, -55, 0, 70, 0, -55, 0], "count": 1000}],
    "open_full": [{"grasp": [1000, 0]}],
    "closehalf": [{"grasp": [0, 500]}],
    "openhalf": [{"grasp": [1000, 500]}],
    "secure_start_position": [
        {"kuka": [5, -75, 0, 85, 0, 70, 0], "count": 100},
        {"kuka": [5, -71, 0, 110, 0, 90, 0], "count": 300},
        {"kuka": [0, 0, 0, 0, 0, 0, 0], "count": 50},
    ],
}
SEQUENCE = [
    "startpos",
    "movetocup",
    "grip",
    "lift",
    "placeposition",
    "startpos",
    "movetocup",
    "open_full",
    "secure_start_position",
]


def messages(routine):
    """Yield topic and data of each message of a routine."""
    for part in ROUTINES[routine]:
        if "kuka" in part:
            for _ in range(part["count"]):
                yield "/kuka", [math.radians(angle) for angle in part["kuka"]]
        else:
            first, last = part["grasp"]
            step = 1 if last >= first else -1
            for i in range(first, last + step, step):
                yield "/grasp", i // 10


def main():
    """Publish the sequence."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--rate", type=float, default=25.0, help="messages a second (default: 25)"
    )
    rate_hz = parser.parse_args().rate

    import rospy
    from std_msgs.msg import Float64MultiArray, Int32

    rospy.init_node("kitchen_client")
    # Long queues, so that a delay of this machine loses no message.
    publishers = {
        "/kuka": rospy.Publisher("/kuka", Float64MultiArray, queue_size=1000),
        "/grasp": rospy.Publisher("/grasp", Int32, queue_size=1000),
    }
    for topic, publisher in publishers.items():
        print("waiting for a subscriber of", topic, flush=True)
        while not publisher.get_num_connections() and not rospy.is_shutdown():
            time.sleep(0.1)
    rate = rospy.Rate(rate_hz)
    with contextlib.suppress(rospy.ROSInterruptException):  # Ctrl-C
        for routine in SEQUENCE:
            print(routine, flush=True)
            for topic, data in messages(routine):
                publishers[topic].publish(data=data)
                rate.sleep()
        time.sleep(1.0)  # for the last message to leave


if __name__ == "__main__":
    main()
