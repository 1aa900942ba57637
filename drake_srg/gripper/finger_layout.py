"""Which joints and links of a gripper carry sensors, and in which order."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping

import numpy as np

from drake_srg.gripper.underactuation import FINGERS, JOINT_NAMES

# Inner normal of every link with a sensor, in the link's frame: y points to the closing
# side.
INWARD = np.array([0.0, 1.0, 0.0])
INWARD.setflags(write=False)


@dc.dataclass(frozen=True, kw_only=True)
class FingerLayout:
    """The joints, links and fingers of a gripper, for its drivers and sensors.

    Attributes:
        joint_names: Joints with an encoder, in the order of everything with one entry
            per joint.
        sensor_links: The link that carries each sensor, by the sensor's name, in the
            order of everything with one entry per sensor.
        fingers: The indices of the sensors of each finger.
        seen: The gripper's own links that a distance sensor sees, by the sensor's name.
            Sensors without an entry see none of them.
    """

    joint_names: tuple[str, ...]
    sensor_links: Mapping[str, str]
    fingers: tuple[tuple[int, ...], ...]
    seen: Mapping[str, tuple[str, ...]]

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """The sensors' names, in order."""
        return tuple(self.sensor_links)


SRG_FINGERS = FingerLayout(
    joint_names=tuple(f"{name}_joint" for name in JOINT_NAMES),
    sensor_links={name: f"{name}_link" for name in JOINT_NAMES},
    fingers=FINGERS,
    seen={
        "left_tip": ("right_base_link", "right_tip_link"),
        "right_tip": ("left_base_link", "left_tip_link"),
    },
)

LINKAGE_FINGERS = FingerLayout(
    joint_names=("master_crank_joint", "slave_crank_joint"),
    sensor_links={"master_tip": "master_tip", "slave_tip": "slave_tip"},
    fingers=((0,), (1,)),
    seen={"master_tip": ("slave_tip",), "slave_tip": ("master_tip",)},
)
