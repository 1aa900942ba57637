"""A can in the open hand, for experiments that close the hand around it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from drake_srg.common.srg_geometry import SRG
from drake_srg.experiments.data import household_objects
from drake_srg.gripper.sensors import ProximityConfig, TouchConfig
from drake_srg.scenario import Scenario
from drake_srg.simulation.rig import bench_scenario
from drake_srg.types import Vector

CAN = "005_tomato_soup_can"
START = 0.1  # of closing, when the hand has come to rest [s]
LOG_PERIOD = 0.002  # s
TOUCHED = TouchConfig().trigger_force  # at which thin-film sensors respond [N]
NEAR = ProximityConfig().trigger_distance  # at which proximity sensors fire [m]
# Height of the palm's middle above the table; the palm points to the front [m].
_HEIGHT = 0.06
# Middle of the can, whose radius is 34 mm, in the palm frame: 4 mm from the palm's face
# at 72 mm. Another 2 mm closer, the base sensors of the open hand fire at once [m].
_X = SRG.palm_face_x + 0.004 + 0.034


def can_in_hand(driver: str, overrides: Sequence[str] = ()) -> Scenario:
    """Return the bench with the open hand around the can on the table.

    Args:
        driver: Of the gripper, as in a scenario file.
        overrides: Entries `KEY=VALUE`, as for `load_scenario`.
    """
    can = household_objects()[CAN]
    can.resolution = 0.005  # as in gripper_bench; the base links' force depends on it
    return bench_scenario(
        can,
        gripper_rpy=[0.0, 0.0, 0.0],
        home=[-_X, 0.0, _HEIGHT],
        overrides=[f"gripper={driver}", *overrides],
    )


def first(time: Vector, condition: npt.NDArray[np.bool_]) -> float:
    """Return when a condition (K,) first holds [s]; NaN if it never does."""
    return float(time[np.argmax(condition)]) if condition.any() else np.nan


def shifts(log: dict[str, Vector]) -> Vector:
    """Return how far the object of a rig's log has moved, shape (K,) [m]."""
    p_WO = log["object_pose.thing"][:, :3]
    return np.linalg.norm(p_WO - p_WO[0], axis=1)
