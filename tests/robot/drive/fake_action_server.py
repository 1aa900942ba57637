"""An action server for an arm's driver, which does what the test says."""

import numpy as np

from drake_srg.robot.drive.arm import Ros2Arm
from drake_srg.robot.serve.action_server import ErrorCode, FollowJointTrajectory
from robot.drive.stand import HOME, PERIOD, FakeNode, joint_state, make

ACTION = FollowJointTrajectory("/arm/follow")
ARM = [f"iiwa_joint_{i}" for i in range(1, 8)]
LEAD = 0.1


class FakeServer:
    """A node with an action server that does to each goal what the test says."""

    def __init__(self, **link):
        self.node = FakeNode()
        config = Ros2Arm(stream="action", action=ACTION.name, lead=LEAD, **link)
        self.link = config.connect(self.node.robot())
        self.time, self.goals, self.canceled = 10.0, [], []
        self.accepts, self.answers = True, True
        self._asked = {}  # request for the result by goal
        self._read = 0

    def step(self, q, stopped=False):
        """Publish the joints' state, and pass the link a command a period later."""
        self.time += PERIOD
        state = joint_state(self.time, ARM, HOME, np.zeros(7))
        assert self.node.deliver("/joint_states", state) == []
        commands = {
            "arm.position_commanded": q,
            "gripper.hold": np.array([float(stopped)]),
        }
        self.link.send(commands)
        self.serve()

    def serve(self):
        """Read what was sent, and answer it."""
        while self._read < len(self.node.sent):
            topic, message = self.node.sent[self._read]
            self._read += 1
            if topic.name == ACTION.send_goal.request:
                self.goals.append(message)
                if self.answers:
                    self.answer(message)
            elif topic.name == ACTION.get_result.request:
                self._asked[bytes(message.goal_id.uuid)] = message
            elif topic.name == ACTION.cancel_goal.request:
                self.canceled.append(bytes(message.goal_info.goal_id.uuid))

    def answer(self, request):
        stamp = make("builtin_interfaces/msg/Time", sec=0, nanosec=0)
        self._reply(ACTION.send_goal, request, accepted=self.accepts, stamp=stamp)

    def end(self, goal, status, code=ErrorCode.SUCCESSFUL, text=""):
        self._reply(
            ACTION.get_result,
            self._asked[bytes(goal.goal_id.uuid)],
            status=int(status),
            error_code=int(code),
            error_string=text,
        )

    def _reply(self, service, request, client=None, **fields):
        client = request.client if client is None else client
        reply = make(service.reply_type, client=client, number=request.number, **fields)
        assert self.node.deliver(service.reply, reply) == []

    def move(self, seconds):
        """Move at a constant speed."""
        for i in range(round(seconds / PERIOD)):
            self.step(HOME + 0.001 * (i + 1))

    def rest(self, seconds, q=HOME, **stopped):
        for _ in range(round(seconds / PERIOD)):
            self.step(q, **stopped)

    @property
    def obeys(self):
        """Whether the link still delivers."""
        return bool(self.link.take())
