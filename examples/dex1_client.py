"""Close and open a humanoid's hand through the topics of Unitree's and SAKE's drivers.

    drake-srg serve gripper_bench --dex1 left --domain 7
    python examples/dex1_client.py left 7

Unitree's SDK has the same topics: ChannelPublisher("rt/dex1/left/cmd", MotorCmds_).
"""

import json
import os
import sys
import time

from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from drake_srg.robot.serve.dex1.messages import MotorCmd, MotorCmds, String

# Loopback without multicast, as in a container; on a robot, name its interface.
LOOPBACK = """<CycloneDDS><Domain>
  <General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces></General>
  <Discovery><ParticipantIndex>auto</ParticipantIndex><Peers AddLocalhost="true"/>
  <MaxAutoParticipantIndex>32</MaxAutoParticipantIndex></Discovery>
</Domain></CycloneDDS>"""


def main() -> None:
    """Wait for the calibration, close, and open half."""
    side = sys.argv[1]
    os.environ.setdefault("CYCLONEDDS_URI", LOOPBACK)
    robot = DomainParticipant(int(sys.argv[2]))
    commands = DataWriter(robot, Topic(robot, f"rt/dex1/{side}/cmd", MotorCmds))
    telemetry = DataReader(robot, Topic(robot, f"rt/gripper/{side}/telemetry", String))
    state = {}

    def listen() -> None:
        for sample in telemetry.take(10):
            state.update(json.loads(sample.data))
        time.sleep(0.005)

    def follow(angle: float) -> None:
        """Command an angle at 200 Hz for 3 s by the hand's clock."""
        end = state["timestamp"] + 3.0
        while state["timestamp"] < end:
            motor = dict.fromkeys(("dq", "tau", "kp", "kd"), 0.0)
            motor |= {"mode": 0, "q": angle, "reserve": [0, 0, 0]}
            commands.write(MotorCmds(cmds=[MotorCmd(**motor)]))
            listen()
        print(f"{state['pos']}, {state['state']}")

    while not state or not state["calibration"]["is_calibrated"]:
        listen()
    follow(0.0)
    follow(2.7)


if __name__ == "__main__":
    main()
