"""Commands to an arm as goals of the action control_msgs/FollowJointTrajectory."""

from __future__ import annotations

import dataclasses as dc
import math
import threading
import uuid
from collections.abc import Sequence
from typing import Any

import numpy as np

from drake_srg.bridges.commands import Warnings
from drake_srg.bridges.ros2.follow_joint_trajectory import (
    ErrorCode,
    FollowJointTrajectory,
    GoalStatus,
    goal_id,
    goal_info,
)
from drake_srg.hardware.arm_streams import ArmStream
from drake_srg.hardware.messages import duration, joint_trajectory
from drake_srg.hardware.nodes import Node
from drake_srg.hardware.service_client import ServiceClient
from drake_srg.hardware.window import Window
from drake_srg.recording.ros_topics import MakeMessage, header
from drake_srg.types import Vector

# How late an answer or a result may be, and how long the server may take to be found,
# by the robot's clock [s].
_PATIENCE = 1.0
# These ends of a goal count even if a newer goal has replaced it meanwhile.
_VIOLATIONS = (ErrorCode.PATH_TOLERANCE_VIOLATED, ErrorCode.GOAL_TOLERANCE_VIOLATED)


@dc.dataclass
class _Goal:
    id: bytes
    end: float  # of its trajectory, by the robot's clock [s]
    accepted: bool = False
    canceled: bool = False  # by us


class GoalStream(ArmStream):
    """Sends goals that reach somewhat ahead, each of which replaces the one before.

    A goal is what a trajectory of `TrajectoryStream` is: positions of the last and the
    next `lead` seconds by the robot's clock. As long as the commands change, there is a
    new one every half `lead`. It begins on the path of the one before, so that a
    joint_trajectory_controller goes on along the same path
    (ros-controls/ros2_controllers, "Trajectory Replacement"). The last one ends where
    the arm is to rest.

    The arm obeys no more once a goal is rejected in time, aborted, or canceled by
    another, once an answer or a result is missing, or once the server has gone. Then
    all goals are canceled, no others are sent, and the user is told. A stop of the
    safety monitor goes along the path, by goals as ever; what is then left of them is
    canceled, and so it is when the stream is closed.

    Args:
        node: The node; not yet open.
        name: Of the action.
        joints: Names of the joints.
        lead: How far ahead the newest command is [s].
        period: Between commands [s].
        warnings: Where trouble is reported.
    """

    def __init__(
        self,
        node: Node,
        name: str,
        joints: Sequence[str],
        lead: float,
        period: float,
        warnings: Warnings,
    ) -> None:
        self.lag = lead
        self._name, self._warnings = name, warnings
        self._window = Window(lead, period)
        self._interval = 0.5 * (lead - period)  # so that rounding costs no period
        trajectory = joint_trajectory(name, joints)

        def goal(make: MakeMessage, id: bytes, times: Vector, q: Vector) -> Any:
            return {
                "goal_id": goal_id(make, id),
                "trajectory": trajectory.convert(make, 0.0, times, q),
                "multi_dof_trajectory": make(
                    "trajectory_msgs/msg/MultiDOFJointTrajectory",
                    header=header(make, 0.0),
                    joint_names=[],
                    points=[],
                ),
                "path_tolerance": [],
                "component_path_tolerance": [],
                "goal_tolerance": [],
                "component_goal_tolerance": [],
                "goal_time_tolerance": duration(make, 0.0),
            }

        action = FollowJointTrajectory(name)
        self._send = ServiceClient[_Goal](node, action.send_goal, goal, self._answered)
        self._result = ServiceClient[_Goal](
            node,
            action.get_result,
            lambda make, id: {"goal_id": goal_id(make, id)},
            self._ended,
        )
        self._cancel = ServiceClient[_Goal](
            node,
            action.cancel_goal,
            lambda make, id: {"goal_info": goal_info(make, id, 0.0)},
            lambda goal, reply: None,  # its result tells
        )
        # Commands come from the control loop, replies from the node's thread.
        self._lock = threading.RLock()
        self._goals: dict[bytes, _Goal] = {}  # sent and not known to have ended
        self._newest: _Goal | None = None
        self._last: Vector | None = None  # command
        self._changed = False  # since the newest goal
        # By the robot's clock [s]: of the first and the last command, and before which
        # there is no new goal.
        self._first, self._stamp, self._next = math.inf, -math.inf, -math.inf
        self._found = False  # the server

    def send(self, q: Vector, stamp: float, *, stopped: bool) -> None:
        """See `ArmStream`."""
        with self._lock:
            if self.fails or not math.isfinite(stamp):
                return
            self._first, self._stamp = min(self._first, stamp), stamp
            times, positions = self._window.after(q, stamp)
            if self._last is None or not np.array_equal(q, self._last):
                self._changed, self._last = True, q.copy()
            if not self._works(stamp):
                return
            if self._changed and stamp >= self._next:
                goal = _Goal(uuid.uuid4().bytes, float(times[-1]))
                self._goals[goal.id] = self._newest = goal
                self._changed, self._next = False, stamp + self._interval
                self._send.call(goal, goal.id, times, positions)
            elif stopped and not self._changed:
                self._cancel_goals(before=stamp)

    def close(self) -> None:
        """See `ArmStream`."""
        with self._lock:
            if not self.fails:
                self._cancel_goals()
            self.fails = True

    def _works(self, stamp: float) -> bool:
        """Return whether the server is there, and all of its replies are."""
        if self._send.there:
            self._found = True
        elif self._found:
            self._fail("the action server has gone")
        elif stamp > self._first + _PATIENCE:
            self._fail("no action server found")
        for goal in list(self._goals.values()):
            if stamp <= goal.end + _PATIENCE:
                continue
            if not goal.accepted:
                self._fail("a goal was not answered")
            elif goal is self._newest:
                self._fail("a goal has ended without a result")
            else:  # replaced long ago; its result is of no interest
                del self._goals[goal.id]
        return self._found and not self.fails

    def _answered(self, goal: _Goal, reply: Any) -> None:
        with self._lock:
            if not reply.accepted:
                self._goals.pop(goal.id, None)
                self._reject(goal)
                return
            goal.accepted = True
        self._result.call(goal, goal.id)

    def _reject(self, goal: _Goal) -> None:
        if self._stamp <= goal.end:
            self._fail("a goal was rejected")
            return
        # A wire or a server was held up. The arm has come to rest meanwhile; if it is
        # far behind, the safety monitor stops the commands.
        self._changed = True  # so that there is another goal, even for a resting arm
        self._warnings.warn(
            f"{self._name} late",
            f"{self._name}: a goal came too late; does `lead` exceed twice the way of "
            "a message there and back?",
        )

    def _ended(self, goal: _Goal, reply: Any) -> None:
        with self._lock:
            self._goals.pop(goal.id, None)
            if reply.status == GoalStatus.SUCCEEDED or goal.canceled:
                return
            if goal is self._newest or reply.error_code in _VIOLATIONS:
                self._fail(_describe(reply))

    def _fail(self, reason: str) -> None:
        if not self.fails:
            self.fails = True
            self._cancel_goals()
            self._warnings.warn(
                f"{self._name} failed", f"{self._name}: {reason}; the arm is stopped"
            )

    def _cancel_goals(self, before: float = math.inf) -> None:
        """Cancel the goals whose trajectories end before a time [s]."""
        for goal in self._goals.values():
            if goal.end < before and not goal.canceled:
                goal.canceled = True
                self._cancel.call(goal, goal.id)


def _describe(reply: Any) -> str:
    """Return in words how a goal has ended."""
    names = {int(status): status.name.lower() for status in GoalStatus}
    codes = {int(code): code.name for code in ErrorCode}
    status = names.get(reply.status, f"ended with status {reply.status}")
    code = codes.get(reply.error_code, str(reply.error_code))
    return f"a goal was {status} ({code}): {reply.error_string or 'no reason given'}"
