"""Quantities from a run's log, for its metrics.

Unless stated otherwise, arrays have one row per sample: `time` [s], `mode` (index into
`MODES`) and `poses` of the picked object (see `pose_to_row`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from drake_srg.common.log_format import MODES, is_pose, pose_key
from drake_srg.common.safety_states import SafetyState, safety_state
from drake_srg.objects.models import simple_shape
from drake_srg.planning.insertion.config import Insert
from drake_srg.scenario import RobotArm, Scenario, robot_arms
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Mode, Vector


def hand_poses(
    scenario: Scenario, arm_states: Vector, robot: RobotArm | None = None
) -> list[RigidTransform]:
    """Return the poses of the palm in world, X_WG [m].

    Args:
        scenario: The scenario with the models of arm and gripper.
        arm_states: States [q; v] of the arm, shape (K, 2N).
        robot: The arm; None: the scenario's only arm.
    """
    robot = robot or RobotArm()
    plant = MakeModelsPlant(scenario)
    context = plant.CreateDefaultContext()
    arm = plant.GetModelInstanceByName(robot.arm_model)
    gripper = plant.GetModelInstanceByName(robot.gripper_model)
    palm = plant.GetFrameByName("palm", gripper)
    poses = []
    for state in arm_states:
        plant.SetPositions(context, arm, state[: plant.num_positions(arm)])
        poses.append(palm.CalcPoseInWorld(context))
    return poses


def end_error(scenario: Scenario, X_WO: RigidTransform) -> Vector | None:
    """Return the distance of a peg's end from its goal, in the hole's frame (3) [m].

    The goal is in the middle of the true hole, at the planner's depth.

    Args:
        scenario: The scenario; its models determine the true place of the hole.
        X_WO: The peg's pose [m].

    Returns:
        The vector from the goal to the end; None unless the planner is `!Insert` and
        there is a hole.
    """
    planner, name = scenario.planner, scenario.task.pick
    if not isinstance(planner, Insert):
        return None
    shape = simple_shape(name, scenario.objects[name])
    plant = MakeModelsPlant(scenario)
    if shape is None or not plant.HasModelInstanceNamed(planner.hole):
        return None
    hole = plant.GetBodyIndices(plant.GetModelInstanceByName(planner.hole))[0]
    X_WH = (
        plant.get_body(hole).body_frame().CalcPoseInWorld(plant.CreateDefaultContext())
    )
    p_HE = X_WH.inverse() @ X_WO @ [0.0, 0.0, -0.5 * shape.height]
    return np.asarray(p_HE) + np.array([0.0, 0.0, planner.depth])


def hole_force(log: Mapping[str, Vector]) -> float | None:
    """Return the greatest force between peg and hole [N]; None if there is no hole."""
    force = log.get("hole_force_cheat")
    return None if force is None else float(force[-1, 0])


# An object this far below both its start and the table has left the table [m].
_OFF_TABLE = 0.2


def off_table(scenario: Scenario, log: Mapping[str, Vector]) -> list[str]:
    """Return the names of the objects that fell off the table."""
    floor = scenario.table.height - _OFF_TABLE
    return [
        name
        for name in scenario.objects
        if (poses := log.get(pose_key(name))) is not None
        and poses[-1, 2] < min(floor, poses[0, 2] - _OFF_TABLE)
    ]


_MAX_HOME_ERROR = 0.01  # largest distance of a joint from home if the arm is home [rad]
# An object that has risen this far is off its support [m]. Toppling raises the middle
# of a 25 mm cylinder by 3 mm, and that of the soup can by 10 mm.
_LIFTED = 0.015
# An object in a bin is at rest below this speed [m/s].
AT_REST = 0.005
# Real motions have a dimensionless jerk of hundreds. A value below this one is due to
# rounding, such as when measurements freeze.
_NO_JERK = 1e-6


def arm_states(
    log: Mapping[str, Vector], arms: Sequence[RobotArm] = (RobotArm(),)
) -> Vector | None:
    """Return the arms' true states [q; v] or, if they are not logged, measured ones.

    Args:
        log: Arrays of log.npz.
        arms: The arms. With several arms, q has the joints of one arm after the other.
    """
    states = [
        log.get(
            f"{arm.arm_model}.state_cheat", log.get(f"{arm.arm_model}.state_measured")
        )
        for arm in arms
    ]
    found = [state for state in states if state is not None]
    if len(found) < 2:
        return found[0] if found else None
    halves = [np.split(state, 2, axis=1) for state in found]
    return np.hstack([*(q for q, _ in halves), *(v for _, v in halves)])


def safety_stops(
    log: Mapping[str, Vector], arms: Sequence[RobotArm] = (RobotArm(),)
) -> list[dict[str, float | str]] | None:
    """Return the stops by safety monitors; None if there is no monitor.

    Each stop has `time_s`, the time of the first sample with the arm stopped, and
    `reason`, the value of a `StopReason`. With several arms, it also has `arm`.
    """
    stops: list[dict[str, float | str]] = []
    monitored = [arm for arm in arms if f"{arm.prefix}safety.state" in log]
    for arm in monitored:
        states = [safety_state(row) for row in log[f"{arm.prefix}safety.state"]]
        running = [state is SafetyState.RUNNING for state, _ in states]
        stops += [
            {
                "time_s": float(log["time"][i]),
                "reason": states[i][1].value,
                **({"arm": arm.name} if arm.name else {}),
            }
            for i in range(len(states))
            if not running[i] and (i == 0 or running[i - 1])
        ]
    return sorted(stops, key=lambda stop: stop["time_s"]) if monitored else None


def final_speed(time: Vector, poses: Vector) -> float:
    """Return the object's mean speed over the last 0.1 s [m/s]."""
    first = int(np.searchsorted(time, time[-1] - 0.1))
    if first == len(time) - 1:
        return float("inf")
    distance = np.linalg.norm(poses[-1, :3] - poses[first, :3])
    return float(distance / (time[-1] - time[first]))


def is_home(scenario: Scenario, log: Mapping[str, Vector]) -> bool:
    """Return whether all arms are at home at the end."""
    arms = robot_arms(scenario)
    homes = [arm.arm.home for arm in arms if arm.arm is not None]
    if not homes:
        return True
    states, home = arm_states(log, arms), np.concatenate(homes)
    assert states is not None
    return bool(np.max(np.abs(states[-1, : len(home)] - home)) <= _MAX_HOME_ERROR)


def grasp_shift(mode: Vector, poses: Vector) -> float | None:
    """Return the object's motion while the fingers close for the last time [m]."""
    rows = _last_rows(mode, Mode.CLOSE)
    if len(rows) == 0:
        return None
    start, end = poses[rows[0], :3], poses[min(rows[-1] + 1, len(poses) - 1), :3]
    return float(np.linalg.norm(end - start))


def grasp_lifted(mode: Vector, poses: Vector) -> bool:
    """Return whether the object is off its support when the last lift ends."""
    rows = _last_rows(mode, Mode.LIFT)
    if len(rows) == 0:
        return False
    return bool(poses[rows[-1], 2] - poses[0, 2] > _LIFTED)


def placed_at(time: Vector, mode: Vector) -> float | None:
    """Return the time at which the hand last opened after placing, or None [s]."""
    ends = (MODES.index(Mode.PLACE), MODES.index(Mode.RELEASE))
    (rows,) = np.nonzero((mode[:-1] == ends[0]) & (mode[1:] == ends[1]))
    return float(time[rows[-1] + 1]) if len(rows) else None


def others_moved(log: Mapping[str, Vector], pick: str) -> float | None:
    """Return the largest distance of any other object from its first position [m]."""
    others = [
        poses[:, :3]
        for name, poses in log.items()
        if is_pose(name) and name != pose_key(pick)
    ]
    if not others:
        return None
    return float(max(np.max(np.linalg.norm(p - p[0], axis=1)) for p in others))


def hold_drift(
    scenario: Scenario,
    time: Vector,
    mode: Vector,
    log: Mapping[str, Vector],
    poses: Vector,
) -> float | None:
    """Return the object's speed in the hand while the lifted arm dwells [m/s].

    None also with several arms, because no mode shows whose hand holds the object.
    """
    if scenario.arms:
        return None
    rows = _last_rows(mode, Mode.LIFT)
    if len(rows) == 0 or not np.any(mode == MODES.index(Mode.TRANSFER)):
        return None
    rows = rows[time[rows] >= time[rows[-1]] - 0.8 * scenario.planner.verify_time]
    if len(rows) < 2:
        return None
    ends = [rows[0], rows[-1]]
    states = arm_states(log)
    assert states is not None
    hands = hand_poses(scenario, states[ends])
    p_GO = [X.inverse() @ poses[i, :3] for X, i in zip(hands, ends, strict=True)]
    return float(np.linalg.norm(p_GO[1] - p_GO[0]) / (time[rows[-1]] - time[rows[0]]))


def smoothness(time: Vector, mode: Vector, arm: Vector | None) -> float | None:
    """Return the log dimensionless jerk of the arm from first motion to last.

    It is `-ln(T³ / v_peak² integral |d²v/dt²|² dt)` (S. Balasubramanian et al., J.
    NeuroEng. Rehabil. 12:112, 2015), where v is the vector of joint velocities, or None
    without motion or if the velocity never changes.

    Args:
        time: Times [s].
        mode: Modes.
        arm: States [q; v] of the arm, shape (K, 2N).
    """
    resting = [MODES.index(m) for m in (Mode.IDLE, Mode.DONE, Mode.FAILED)]
    rows = np.flatnonzero(~np.isin(mode, resting))
    if arm is None or len(rows) < 5:
        return None
    rows = np.arange(rows[0], rows[-1] + 1)
    t = time[rows]
    v = arm[rows, arm.shape[1] // 2 :]
    peak = np.max(np.linalg.norm(v, axis=1))
    if peak == 0.0:
        return None
    jerk = np.gradient(np.gradient(v, t, axis=0), t, axis=0)
    squared = np.trapezoid(np.sum(jerk**2, axis=1), t)
    dimensionless = (t[-1] - t[0]) ** 3 / peak**2 * squared
    if dimensionless < _NO_JERK:
        return None
    return float(-np.log(dimensionless))


def _last_rows(mode: Vector, wanted: Mode) -> npt.NDArray[np.intp]:
    """Return the rows of the last uninterrupted stretch of a mode."""
    rows = np.flatnonzero(mode == MODES.index(wanted))
    if len(rows) == 0:
        return rows
    breaks = np.flatnonzero(np.diff(rows) > 1)
    return rows[breaks[-1] + 1 :] if len(breaks) else rows
