"""One-shot grasps from a data set of `drake-srg dataset`, for behaviour cloning.

An episode of the data set is a run of a cell, from which one grasp is taken: the hand's
pose at the last increase of the commanded closure, relative to the last sighting of the
object.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RollPitchYaw

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.common.tables import parse_json
from drake_srg.learning.envs.hand_task import Mover
from drake_srg.learning.envs.tasks import GraspOneShotEnv, action_of, one_shot_state
from drake_srg.learning.policy import Array
from drake_srg.sweeps.rows import require_sweep
from drake_srg.types import Box, Cylinder, Failure, Shape, Vector

_SIGHTING = "observation.environment_state"
_CLOSES = 0.05  # least growth of the commanded closure in a grasp
# The hand points down if turning it down changes no joint by more than this [rad or m].
_TILTED = 0.02

Demonstration = tuple[Array, Array]  # observation and action of `GraspOneShot`


def read_demonstrations(folder: Path, env: Any) -> list[Demonstration]:
    """Return the successful grasps of a data set that fit the environment.

    A grasp was successful if the object reached its goal, or a place near it
    (`misplaced`). Grasps that are not possible actions of the environment, such as
    those from the side, are left out.

    Args:
        folder: Folder of the data set.
        env: A `GraspOneShotEnv`, of the arm with which the data set was recorded.

    Raises:
        ScenarioError: If the folder is not such a data set, belongs to another arm, or
            has no usable grasps.
        ImportError: If PyArrow is missing.
    """
    task = env.unwrapped
    if not isinstance(task, GraspOneShotEnv):
        raise ScenarioError(
            f"--data {folder}: a data set shows one-shot grasps (allowed with "
            "GraspOneShot, got another environment)"
        )
    try:
        joints = _arm_joints(folder)
        episodes = list(_episodes(folder))
    except OSError as error:
        reason = error.strerror or one_line(error)
        raise ScenarioError(f"--data {folder}: cannot be read: {reason}") from None
    except (ValueError, KeyError, TypeError) as error:  # of PyArrow, too
        raise ScenarioError(
            f"--data {folder}: is not a data set of drake-srg dataset: "
            f"{one_line(error)}"
        ) from None
    if joints != len(task.q_start):
        raise ScenarioError(
            f"--data {folder}: is of an arm with {joints} joints, the environment's "
            f"has {len(task.q_start)} (allowed: --set scenario=SCENARIO of that arm)"
        )
    found = [
        demonstration
        for shape, action, sighting in episodes
        if (demonstration := grasp_in(shape, action, sighting, task.mover, task.table))
    ]
    if not found:
        raise ScenarioError(
            f"--data {folder}: no episode has a grasp from above that held a known "
            "cylinder or box"
        )
    return found


def grasp_in(
    shape: Shape, action: Vector, sighting: Vector, mover: Mover, table: float
) -> Demonstration | None:
    """Return the grasp of an episode; None if the hand does not grasp from above.

    Args:
        shape: Shape of the object.
        action: Commanded joints of the arm and closure, shape (frames, N + 1).
        sighting: Last seen pose of the object: x, y, z, quaternion x, y, z, w, and 1 if
            it was seen at all, shape (frames, 8).
        mover: Mover of the arm.
        table: Height of the table [m].
    """
    (grows,) = np.nonzero(np.diff(action[:, -1]) > _CLOSES)
    if not len(grows):
        return None
    k = int(grows[-1]) + 1  # the first frame that closes: the arm stands still
    q, seen = action[k, :-1], sighting[k]
    pose = mover.pose(q)
    if seen[7] < 0.5 or np.abs(mover.follow(q, pose) - q).max() > _TILTED:
        return None
    x, y, z, w = seen[3:7] / np.linalg.norm(seen[3:7])
    round_ = isinstance(shape, Cylinder)
    yaw = 0.0 if round_ else RollPitchYaw(Quaternion(w, x, y, z)).yaw_angle()
    chosen = action_of(
        pose, action[k - 1, -1], action[k, -1], np.append(seen[:3], yaw), table
    )
    if np.abs(chosen).max() > 1.0:
        return None
    return one_shot_state(shape), chosen


def _arm_joints(folder: Path) -> int:
    info = parse_json((folder / "meta" / "info.json").read_text(encoding="utf-8"))
    names = info["features"]["action"]["names"]
    if names[-1] != "gripper_closure" or _SIGHTING not in info["features"]:
        raise ValueError(f"needs gripper_closure and {_SIGHTING}")
    return len(names) - 1


def _episodes(folder: Path) -> Iterator[tuple[Shape, Vector, Vector]]:
    """Yield shape, actions and sightings of every episode whose grasp held."""
    pq = require_sweep("pyarrow.parquet")
    about = pq.read_table(folder / "meta" / "episodes")
    columns = [
        "success",
        "failure",
        "object_size",
        "object_round",
        "dataset_from_index",
    ]
    rows = about.select([*columns, "dataset_to_index"]).to_pylist()
    frames = pq.read_table(folder / "data", columns=["index", "action", _SIGHTING])
    frames = frames.sort_by("index")
    action, sighting = (
        np.array(frames[name].to_pylist(), float) for name in ("action", _SIGHTING)
    )
    for row in rows:
        held = row["success"] or row["failure"] == Failure.MISPLACED.value
        if held and row["object_size"]:
            part = slice(row["dataset_from_index"], row["dataset_to_index"])
            size = row["object_size"]
            shape: Shape = Box(size)
            if row["object_round"]:
                shape = Cylinder(radius=0.5 * size[0], length=size[2])
            yield shape, action[part], sighting[part]
