"""Topics that command a served arm that follows trajectories."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from drake_srg.arm.trajectory_follower import CAPACITY, trajectory_piece
from drake_srg.bridges.commands import (
    CommandError,
    CommandTopic,
    PortValues,
    arm_joint_names,
    checked_positions,
    joint_limits,
)
from drake_srg.types import Vector

TRAJECTORY = "arm.trajectory_desired"
_KIND = "trajectory_msgs/msg/JointTrajectory"


def trajectory_topics(
    plant: MultibodyPlant, inputs: Iterable[str], period: float
) -> list[CommandTopic]:
    """Return the topics of an arm that follows trajectories; none for another.

    `/joint_trajectory` (JointTrajectory): the arm moves evenly from point to point. The
    joints may come in any order. `/kuka` (Float64MultiArray, rad, one number per
    joint): the arm is there one period later.

    Args:
        plant: Has the model instance `arm`.
        inputs: Names of the station's input ports.
        period: Of the arm's driver [s].
    """
    if TRAJECTORY not in inputs:
        return []

    def at_once(q: Vector) -> PortValues:
        return {TRAJECTORY: trajectory_piece(np.array([period]), q[np.newaxis])}

    return [
        CommandTopic("/joint_trajectory", _KIND, trajectory_command(plant), whole=True),
        CommandTopic(
            "/kuka",
            "std_msgs/msg/Float64MultiArray",
            checked_positions(joint_limits(plant, "arm"), at_once, obeyed=True),
        ),
    ]


def trajectory_command(plant: MultibodyPlant) -> Callable[[Any], PortValues]:
    """Return what checks a JointTrajectory and makes a command of it.

    It raises a CommandError if the trajectory is invalid.

    Args:
        plant: Has the model instance `arm`.
    """
    names = arm_joint_names(plant)
    check = checked_positions(
        joint_limits(plant, "arm"), lambda q: {"": q}, obeyed=True
    )

    def command(message: Any) -> PortValues:
        given, points = list(message.joint_names), message.points
        if sorted(given) != sorted(names):
            raise CommandError("joints", f"needs the joints {', '.join(names)}")
        if not 0 < len(points) <= CAPACITY:
            raise CommandError(
                "points", f"needs 1 to {CAPACITY} points, got {len(points)}"
            )
        order = [given.index(name) for name in names]
        positions = []
        for point in points:
            if len(point.positions) != len(names):
                raise CommandError("length", f"needs {len(names)} positions per point")
            positions.append(check(np.array(point.positions)[order])[""])
        times = np.array([seconds(point.time_from_start) for point in points])
        if np.any(np.diff(times, prepend=-1e-9) <= 0.0):
            raise CommandError("times", "needs points in the order of their times")
        start = seconds(message.header.stamp)
        return {TRAJECTORY: trajectory_piece(times, np.array(positions), start)}

    return command


def seconds(time: Any) -> float:
    """Return a builtin_interfaces/Time or Duration in seconds."""
    return float(time.sec) + 1e-9 * float(time.nanosec)
