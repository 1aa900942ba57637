"""What a run is judged by: from the log and the ground truth, after the fact."""

import dataclasses as dc
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform

from drake_srg.cell.goals import final_pose, final_tilt
from drake_srg.recording.output import OutputFile
from drake_srg.scenario import Scenario
from drake_srg.simulation.hand_poses import hand_poses
from drake_srg.types import Failure, Mode, PlannerStatus, Vector

SCHEMA_VERSION = 1
MODES = list(Mode)

# When a placed object counts as resting upright, and the arm as home.
_MAX_SPEED = 1e-3  # m/s
_MAX_TILT = np.deg2rad(5.0)
_MAX_HOME_ERROR = 0.01  # rad


@dc.dataclass
class Metrics:
    """The contents of metrics.json, in SI units; None where one does not apply."""

    scenario: str
    seed: int
    success: bool
    # The planner's own word, or `misplaced` where it said done and was wrong.
    failure: str | None
    attempts: int
    cycles: int  # times the object was placed
    # From the first localisation that led to a grasp to the arm back home, a cycle [s].
    cycle_time_s: float | None
    planning_wall_s: float
    localization_error_m: list[float] | None  # estimate minus truth
    placement_error_m: list[float] | None  # final position minus goal
    placement_tilt_rad: float | None  # None for a ball
    grasp_shift_m: float | None  # motion of the object while the fingers close
    smoothness: float | None  # log dimensionless jerk of the arm; higher is smoother
    hold_drift_m_per_s: float | None  # in the hand, while the lifted arm dwells
    # Largest contact of the gripper with the object among the samples of the log [N].
    peak_contact_force_n: float | None
    # Largest distance of any other object from where it stood at first, at any time.
    others_moved_m: float | None
    sim_time_s: float
    wall_time_s: float
    real_time_factor: float
    artifacts: dict[str, str | None]
    schema_version: int = SCHEMA_VERSION

    def table(self) -> str:
        """Return what people want to know first, as text."""

        def show(value: float | None, scale: float, unit: str) -> str:
            return "-" if value is None else f"{scale * value:.3g} {unit}"

        def across(vector: list[float] | None) -> str:
            if vector is None:
                return "-"
            return ", ".join(f"{1e3 * x:.2f}" for x in vector) + " mm"

        word = "success" if self.success else f"failure: {self.failure}"
        rows = [
            ("scenario", f"{self.scenario}, seed {self.seed}"),
            ("result", f"{word}, {self.attempts} attempt(s)"),
            ("cycle", show(self.cycle_time_s, 1.0, "s")),
            ("localisation error", across(self.localization_error_m)),
            ("placement error", across(self.placement_error_m)),
            ("placement tilt", show(self.placement_tilt_rad, 180.0 / np.pi, "degrees")),
            ("shift while closing", show(self.grasp_shift_m, 1e3, "mm")),
            ("drift in the hand", show(self.hold_drift_m_per_s, 1e6, "um/s")),
            ("largest grip force", show(self.peak_contact_force_n, 1.0, "N")),
            ("other objects moved", show(self.others_moved_m, 1e3, "mm")),
            ("planning", show(self.planning_wall_s, 1.0, "s of wall clock")),
            ("speed", f"{self.real_time_factor:.2f} x real time"),
        ]
        return "\n".join(f"{name:20} {value}" for name, value in rows)

    def write(self, path: Path) -> None:
        """Write metrics.json, whole or not at all; what is not finite becomes null."""
        text = json.dumps(dc.asdict(self))
        values = json.loads(text, parse_constant=lambda name: None)
        output = OutputFile(path)
        output.path.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")
        output.commit()


@dc.dataclass(frozen=True)
class RunTimes:
    """How long a run took [s]."""

    simulated: float
    wall: float


def calc_metrics(
    scenario: Scenario,
    name: str,
    log: Mapping[str, Vector],
    status: PlannerStatus,
    touching: set[str],
    times: RunTimes,
    artifacts: dict[str, str | None],
) -> Metrics:
    """Judge a run.

    Args:
        scenario: What was simulated.
        name: Its name.
        log: Arrays of log.npz, one row a sample.
        status: The planner's last word.
        touching: Names of the bodies that touch the picked object in the end, as
            `ContactReader.forces` names them.
        times: Duration of the run.
        artifacts: Paths of the files that the run wrote.
    """
    pick = scenario.task.pick
    time, mode = log["time"], log["mode"].astype(int)
    poses = log.get(f"object_pose.{pick}")
    placed, error, tilt = False, None, None
    localization = shift = drift = peak = cycle = None
    if poses is not None:
        final = _transform(poses[-1])
        first = 0  # where the object was first found
        if status.localization is not None:
            first = int(np.searchsorted(time, status.localized_at - 1e-9))
            localization = status.localization.position - poses[first, :3]
        start, place = _transform(poses[first]), scenario.task.place
        goal = final_pose(scenario, start)
        error = final.translation() - goal.translation()
        tilt = final_tilt(scenario, start, final)
        placed = bool(
            np.linalg.norm(error) <= place.tolerance
            and (tilt is None or tilt <= _MAX_TILT)
            and _final_speed(time, poses) <= _MAX_SPEED
            and not touching - {"support"}
            and "support" in touching
            and _is_home(scenario, log)
        )
        shift = _grasp_shift(mode, poses)
        drift = _hold_drift(scenario, time, mode, log, poses)
        peak = float(np.max(log["contact_force"])) or None  # None: never touched
    if status.mode is Mode.DONE:
        done = time[mode == MODES.index(Mode.DONE)][0]
        cycle = float(done - status.localized_at) / max(status.cycles, 1)
    success = placed and status.mode is Mode.DONE
    failure = status.failure
    if status.mode is Mode.DONE and not success:
        failure = Failure.MISPLACED
    elif status.mode not in (Mode.DONE, Mode.FAILED):
        failure = Failure.TIME_BUDGET
    return Metrics(
        scenario=name,
        seed=scenario.random_seed,
        success=success,
        failure=failure.value if failure else None,
        attempts=status.attempts,
        cycles=status.cycles,
        cycle_time_s=cycle,
        planning_wall_s=status.planning_wall,
        localization_error_m=_floats(localization),
        placement_error_m=_floats(error),
        placement_tilt_rad=tilt,
        grasp_shift_m=shift,
        smoothness=_smoothness(time, mode, _arm_states(log)),
        hold_drift_m_per_s=drift,
        peak_contact_force_n=peak,
        others_moved_m=_others_moved(log, pick),
        sim_time_s=times.simulated,
        wall_time_s=times.wall,
        real_time_factor=times.simulated / times.wall,
        artifacts=artifacts,
    )


def pose_to_row(X: RigidTransform) -> Vector:
    """Return [x, y, z, qw, qx, qy, qz] of a pose, shape (7,)."""
    return np.concatenate([X.translation(), X.rotation().ToQuaternion().wxyz()])


def _arm_states(log: Mapping[str, Vector]) -> Vector | None:
    """The arm's true states [q; v]; where no one tells, those that are measured."""
    return log.get("arm.state_cheat", log.get("arm.state_measured"))


def _transform(row: Vector) -> RigidTransform:
    return RigidTransform(Quaternion(row[3:] / np.linalg.norm(row[3:])), row[:3])


def _final_speed(time: Vector, poses: Vector) -> float:
    """Mean speed over the last 0.1 s [m/s]."""
    first = int(np.searchsorted(time, time[-1] - 0.1))
    if first == len(time) - 1:
        return float("inf")
    distance = np.linalg.norm(poses[-1, :3] - poses[first, :3])
    return float(distance / (time[-1] - time[first]))


def _is_home(scenario: Scenario, log: Mapping[str, Vector]) -> bool:
    if scenario.arm is None:
        return True
    states = _arm_states(log)
    assert states is not None
    q = states[-1, : len(scenario.arm.home)]
    return bool(np.max(np.abs(q - scenario.arm.home)) <= _MAX_HOME_ERROR)


def _last_rows(mode: Vector, wanted: Mode) -> npt.NDArray[np.intp]:
    """Rows of the last uninterrupted stretch of a mode."""
    rows = np.flatnonzero(mode == MODES.index(wanted))
    if len(rows) == 0:
        return rows
    breaks = np.flatnonzero(np.diff(rows) > 1)
    return rows[breaks[-1] + 1 :] if len(breaks) else rows


def _grasp_shift(mode: Vector, poses: Vector) -> float | None:
    rows = _last_rows(mode, Mode.CLOSE)
    if len(rows) == 0:
        return None
    start, end = poses[rows[0], :3], poses[min(rows[-1] + 1, len(poses) - 1), :3]
    return float(np.linalg.norm(end - start))


def _others_moved(log: Mapping[str, Vector], pick: str) -> float | None:
    others = [
        poses[:, :3]
        for name, poses in log.items()
        if name.startswith("object_pose.") and name != f"object_pose.{pick}"
    ]
    if not others:
        return None
    return float(max(np.max(np.linalg.norm(p - p[0], axis=1)) for p in others))


def _hold_drift(
    scenario: Scenario,
    time: Vector,
    mode: Vector,
    log: Mapping[str, Vector],
    poses: Vector,
) -> float | None:
    """Speed of the object in the hand while the arm dwells after lifting [m/s]."""
    rows = _last_rows(mode, Mode.LIFT)
    if len(rows) == 0 or not np.any(mode == MODES.index(Mode.TRANSFER)):
        return None
    rows = rows[time[rows] >= time[rows[-1]] - 0.8 * scenario.planner.verify_time]
    if len(rows) < 2:
        return None
    ends = [rows[0], rows[-1]]
    states = _arm_states(log)
    assert states is not None
    hands = hand_poses(scenario, states[ends])
    p_GO = [X.inverse() @ poses[i, :3] for X, i in zip(hands, ends, strict=True)]
    return float(np.linalg.norm(p_GO[1] - p_GO[0]) / (time[rows[-1]] - time[rows[0]]))


def _smoothness(time: Vector, mode: Vector, arm: Vector | None) -> float | None:
    """Log dimensionless jerk of the joint speeds from the first motion to the last.

    -ln(T³ / v_peak² integral |d²v/dt²|² dt) (S. Balasubramanian et al., J. NeuroEng.
    Rehabil. 12:112, 2015), v the vector of joint velocities.
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
    return float(-np.log((t[-1] - t[0]) ** 3 / peak**2 * squared))


def _floats(vector: Vector | None) -> list[float] | None:
    return None if vector is None else [float(x) for x in vector]
