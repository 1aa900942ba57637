"""The timeline of a run's log."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping

from drake_srg.common.log_keys import pose_key
from drake_srg.recording.timeline import Timeline
from drake_srg.types import Mode, Vector

_MODES = list(Mode)


@dc.dataclass(frozen=True)
class Labels:
    """What a log does not tell about its columns.

    Attributes:
        title: The run's.
        pick: Name of the picked object.
        gripper_joints: Names of the gripper's measured joints.
        sensors: Names of the finger sensors.
        arm_slides: Whether the arm's joints are prismatic.
    """

    title: str
    pick: str = ""
    gripper_joints: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ()
    arm_slides: bool = False


def run_timeline(log: Mapping[str, Vector], labels: Labels) -> Timeline:
    """Return the timeline of a log that `Simulate` wrote."""
    arm = log["arm.state_measured"]
    gripper = log.get("gripper.state_measured")
    poses = log.get(pose_key(labels.pick))
    return Timeline(
        time=log["time"],
        mode=[_MODES[int(i)].value for i in log["mode"]],
        gripper_position=(
            None if gripper is None else gripper[:, : len(labels.gripper_joints)]
        ),
        gripper_joints=[
            _words(n.removesuffix("_joint")) for n in labels.gripper_joints
        ],
        closure=log.get("gripper.closure_commanded"),
        proximity=log.get("gripper.proximity"),
        sensors=[_words(name) for name in labels.sensors],
        grip_force=log.get("contact_force"),
        arm_velocity=arm[:, arm.shape[1] // 2 :],
        arm_torque=log.get("arm.torque_measured"),
        arm_slides=labels.arm_slides,
        object_height=None if poses is None else poses[:, 2],
        title=labels.title,
    )


def _words(name: str) -> str:
    return name.replace("_", " ")
