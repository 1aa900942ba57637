"""Close and open a humanoid's hand through the topics of Unitree's and SAKE's drivers.

    drake-srg serve gripper_bench --dex1 left --domain 7
    python examples/dex1_client.py left 7

With Unitree's SDK, the same topics and types are ChannelPublisher("rt/dex1/left/cmd",
MotorCmds_) and ChannelSubscriber("rt/gripper/left/telemetry", String_).
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
    """Wait for the calibration, close until the hand grasps, and open it."""
    side, domain = sys.argv[1], int(sys.argv[2])
    os.environ.setdefault("CYCLONEDDS_URI", LOOPBACK)
    robot = DomainParticipant(domain)
    commands = DataWriter(robot, Topic(robot, f"rt/dex1/{side}/cmd", MotorCmds))
    telemetry = DataReader(robot, Topic(robot, f"rt/gripper/{side}/telemetry", String))
    state = {"calibration": {"is_calibrated": False}}

    def follow(angle: float, until: str) -> None:
        """Command an angle at 200 Hz until the hand is in a state, at most 30 s."""
        end = time.monotonic() + 30.0
        while time.monotonic() < end and state.get("state") != until:
            motor = dict.fromkeys(("dq", "tau", "kp", "kd"), 0.0)
            command = MotorCmd(mode=0, q=angle, reserve=[0, 0, 0], **motor)
            commands.write(MotorCmds(cmds=[command]))
            time.sleep(0.005)
            for sample in telemetry.take(10):
                state.update(json.loads(sample.data))
        print(f"{state.get('state')} at {state.get('pos')}")

    while not state["calibration"]["is_calibrated"]:
        for sample in telemetry.take(10):
            state.update(json.loads(sample.data))
        time.sleep(0.01)
    follow(0.0, "grasping")
    follow(2.7, "moving")


if __name__ == "__main__":
    main()
