"""Metrics of a run, computed from its log and ground truth after its end."""

import dataclasses as dc
import json
import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.common.log_format import MODES, pose_key, row_to_pose
from drake_srg.objects.models import simple_shape
from drake_srg.planning.insertion.config import Insert
from drake_srg.recording.output import OutputFile, count_phrase, verdict
from drake_srg.scenario import Scenario, robot_arms
from drake_srg.simulation import measures
from drake_srg.simulation.between_arms import (
    carried_tilt,
    count_arm_contacts,
    largest_internal_force,
    min_arm_distance,
)
from drake_srg.simulation.clearing import clearing_outcome
from drake_srg.station.planners import final_pose, final_tilt
from drake_srg.types import Failure, Mode, PlannerStatus, Vector
from drake_srg.vision.solids import turn_between

SCHEMA_VERSION = 1
# Entries for tasks with several objects only.
OF_SEVERAL = (
    *("objects_total", "objects_cleared", "objects"),
    *("objects_sorted", "objects_in_wrong_bin"),
    *("picks", "picks_held", "picks_delivered", "picks_per_hour"),
    *("multi_object_picks", "multi_object_picks_seen"),
)
OF_INSERTION = ("floor_gap_m", "hole_force_n")

# Entries that are left out of metrics.json if they are null.
OF_SOME = (
    *("safety_stops", "claimed", "off_table", "kinds"),
    *("min_arm_distance_m", "arm_contacts"),
    *("internal_force_n", "max_tilt_deg"),
)

# Limits for an object that rests upright.
_MAX_SPEED = 1e-3  # m/s
_MAX_TILT = np.deg2rad(5.0)
# Largest distance of a peg's end from the axis of its hole if it is in the hole [m].
# The clearance is at most 1 mm, and the narrowest hole has a radius of 6 mm.
_INSIDE = 0.005
# Largest distance of an inserted peg from its seat [m]: half of a chamfer. Seated pegs
# end within 0.01 mm. (`depth_tolerance` is only for the planner, which feels the rim.)
_SEATED = 5e-4


def rounded(value: float) -> str:
    """Return a measured value with three digits; a value far below 1 becomes 0."""
    return f"{value:.3g}" if abs(value) >= 5e-4 else "0"


@dc.dataclass
class Metrics:
    """The contents of metrics.json in SI units; None if a metric does not apply."""

    scenario: str
    seed: int
    success: bool
    # The planner's reason, or `misplaced` if it reported success and was wrong.
    failure: str | None
    attempts: int
    cycles: int  # number of times that the object was placed
    # Mean time per cycle, from the first localisation that led to a grasp until the arm
    # is back home [s].
    cycle_time_s: float | None
    # Time from the same moment until the hand opens at the goal [s]; None unless the
    # planner has placed the object exactly once. The five-axis arm's thesis reports it.
    time_to_placement_s: float | None
    planning_wall_s: float
    localization_error_m: list[float] | None  # estimate minus truth
    # Angle between the estimated and the true orientation, apart from symmetries of the
    # shape: 0 for a ball, the angle between the axes for a cylinder.
    localization_turn_rad: float | None
    placement_error_m: list[float] | None  # final position minus goal
    placement_tilt_rad: float | None  # None for a sphere
    # Whether the object was off its support when the last lift ended. The five-axis
    # arm's thesis calls this a successful grasp.
    grasp_lifted: bool | None
    grasp_shift_m: float | None  # motion of the object while the fingers close
    smoothness: float | None  # log dimensionless jerk of the arm; higher is smoother
    # Speed of the object in the hand while the arm dwells after lifting.
    hold_drift_m_per_s: float | None
    # Largest contact force of the gripper on the object among the log's samples [N].
    peak_contact_force_n: float | None
    # Largest distance of any other object from its first position, at any time. In
    # tasks with several objects, that of any object that must stay, since the first
    # pick was planned.
    others_moved_m: float | None
    sim_time_s: float
    wall_time_s: float
    real_time_factor: float
    artifacts: dict[str, str | None]
    schema_version: int = SCHEMA_VERSION
    # Only for tasks with several objects (up to `objects`): the number of objects, and
    # of those that rest where they belong; see `ClearingOutcome`.
    objects_total: int | None = None
    objects_cleared: int | None = None
    # With several bins: number of objects in their own bin, and in another.
    objects_sorted: int | None = None
    objects_in_wrong_bin: int | None = None
    # Grasps; loads that the planner counts as arrived, at most one per grasp; grasps
    # whose load rests where it belongs, by ground truth; `picks_held` per hour.
    picks: int | None = None
    picks_held: int | None = None
    picks_delivered: int | None = None
    picks_per_hour: float | None = None
    # Grasps that carried several objects, by ground truth and as the planner saw it.
    multi_object_picks: int | None = None
    multi_object_picks_seen: int | None = None
    # Outcome for each object; see `ObjectOutcome`.
    objects: dict[str, dict[str, Any]] | None = None
    # Only with a safety monitor: the stops; see `measures.safety_stops`.
    safety_stops: list[dict[str, float | str]] | None = None
    # Only on hardware: whether the planner reports that it has done the task. There is
    # no ground truth, so `success` is False here, and null in metrics.json.
    claimed: bool | None = None
    # Only with `!Insert`, by ground truth: height of the peg's end above the hole's
    # floor, and the greatest force between peg and hole; see `PeakForce`. The place of
    # the peg's end, not the placement error and tilt, decides whether it is placed.
    floor_gap_m: float | None = None
    hole_force_n: float | None = None
    # Only if objects fell off the table: their names. If the picked object did, it has
    # no placement error.
    off_table: list[str] | None = None
    # Only with clutter: the kinds of drawn objects, by the objects' names.
    kinds: dict[str, str] | None = None
    # Only with several arms: the least distance between two arms in any sample of the
    # log, and the number of times that they touched.
    min_arm_distance_m: float | None = None
    arm_contacts: int | None = None
    # Only with `!CarryTogether`, in any sample of the log: the largest force with which
    # the hands press on each other (see `InternalForce`), and the largest tilt of the
    # object while both carry it.
    internal_force_n: float | None = None
    max_tilt_deg: float | None = None

    def table(self) -> str:
        """Return the most important metrics as text."""

        def show(value: float | None, scale: float, unit: str) -> str:
            return "-" if value is None else f"{rounded(scale * value)} {unit}"

        def degrees(value: float | None) -> str:
            return show(value, 180.0 / np.pi, "degrees")

        def across(vector: list[float] | None) -> str:
            if vector is None:
                return "-"
            # Adding 0 turns a rounded -0 into 0.
            return ", ".join(f"{round(1e3 * x, 2) + 0.0:.2f}" for x in vector) + " mm"

        if self.objects is not None:
            return self._objects_table(self.objects)
        rows = [
            ("scenario", f"{self.scenario}, seed {self.seed}"),
            ("result", verdict(vars(self))),
            ("cycle", show(self.cycle_time_s, 1.0, "s")),
            ("localisation error", across(self.localization_error_m)),
            ("localisation turn", degrees(self.localization_turn_rad)),
            ("placement error", across(self.placement_error_m)),
            ("placement tilt", degrees(self.placement_tilt_rad)),
            ("shift while closing", show(self.grasp_shift_m, 1e3, "mm")),
            ("drift in the hand", show(self.hold_drift_m_per_s, 1e6, "um/s")),
            ("largest grip force", show(self.peak_contact_force_n, 1.0, "N")),
            ("other objects moved", show(self.others_moved_m, 1e3, "mm")),
            *(
                [
                    ("above the floor", show(self.floor_gap_m, 1e3, "mm")),
                    ("force on the hole", show(self.hole_force_n, 1.0, "N")),
                ]
                if self.floor_gap_m is not None
                else []
            ),
            *self._off_table_rows(),
            *self._arms_rows(),
            *(
                ("safety stop", f"{stop['reason']} at {stop['time_s']:.2f} s")
                for stop in self.safety_stops or ()
            ),
            ("planning", show(self.planning_wall_s, 1.0, "s of wall clock")),
            ("speed", f"{self.real_time_factor:.2f} x real time"),
        ]
        return "\n".join(f"{name:20} {value}" for name, value in rows)

    def _objects_table(self, objects: Mapping[str, Mapping[str, Any]]) -> str:
        rate = "-" if self.picks_per_hour is None else f"{self.picks_per_hour:.0f}"
        rows = [
            ("scenario", f"{self.scenario}, seed {self.seed}"),
            ("result", verdict(vars(self))),
            *self._choice_rows(),
            ("picks", f"{self.picks_held} held of {self.picks}, {rate} per hour"),
            *self._multi_object_rows(),
            *(
                (
                    self._called(name),
                    f"{thing['outcome']}, {count_phrase(thing['attempts'], 'attempt')}",
                )
                for name, thing in objects.items()
            ),
            *self._off_table_rows(),
            ("planning", f"{self.planning_wall_s:.3g} s of wall clock"),
            ("speed", f"{self.real_time_factor:.2f} x real time"),
        ]
        width = max(20, *(len(name) for name, _ in rows))
        return "\n".join(f"{name:{width}} {value}" for name, value in rows)

    def _called(self, name: str) -> str:
        """Return the name of an object, with its kind if a seed drew it."""
        kind = (self.kinds or {}).get(name)
        return name if kind is None else f"{name} ({kind})"

    def _off_table_rows(self) -> list[tuple[str, str]]:
        names = ", ".join(map(self._called, self.off_table or ()))
        return [("off the table", names)] if names else []

    def _arms_rows(self) -> list[tuple[str, str]]:
        if self.min_arm_distance_m is None:
            return []
        near = f"{rounded(1e3 * self.min_arm_distance_m)} mm"
        contacts = count_phrase(self.arm_contacts or 0, "contact")
        rows = [("between the arms", f"{near} at least, {contacts}")]
        if self.internal_force_n is not None:
            rows.append(("internal force", f"{rounded(self.internal_force_n)} N"))
        if self.max_tilt_deg is not None:
            rows.append(("largest tilt", f"{rounded(self.max_tilt_deg)} degrees"))
        return rows

    def _multi_object_rows(self) -> list[tuple[str, str]]:
        if not self.multi_object_picks and not self.multi_object_picks_seen:
            return []
        seen = f"{self.multi_object_picks_seen} seen by the planner"
        return [("multi-object picks", f"{self.multi_object_picks}, {seen}")]

    def _choice_rows(self) -> list[tuple[str, str]]:
        """Return the rows about wrong bins and about objects that must stay."""
        rows = []
        if self.objects_in_wrong_bin is not None:
            wrong = count_phrase(self.objects_in_wrong_bin, "object")
            rows.append(("in a wrong bin", wrong))
        if self.others_moved_m is not None:
            moved = f"{rounded(1e3 * self.others_moved_m)} mm"
            rows.append(("other objects moved", moved))
        return rows

    def write(self, path: Path) -> None:
        """Write metrics.json completely or not at all; infinity and NaN become null."""
        fields = dc.asdict(self)
        if self.objects is None:
            fields = {k: v for k, v in fields.items() if k not in OF_SEVERAL}
        if self.claimed is not None:
            fields["success"] = None
        for name in (*OF_SOME, *OF_INSERTION):
            if fields[name] is None:
                del fields[name]
        text = json.dumps(fields)
        values = json.loads(text, parse_constant=lambda name: None)
        output = OutputFile(path)
        output.path.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")
        output.commit()


@dc.dataclass(frozen=True)
class RunTimes:
    """Duration of a run in simulated time and on the wall clock [s]."""

    simulated: float
    wall: float
    planning: float = 0.0  # part of `wall` that the planner took


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
        scenario: The scenario that was simulated.
        name: The scenario's name.
        log: Arrays of log.npz, one row per sample.
        status: The planner's last status.
        touching: Names of the bodies that touch the picked object at the end, as
            `ContactReader.forces` names them.
        times: Duration of the run.
        artifacts: Paths of the files that the run wrote, by kind.
    """
    pick, arms = scenario.task.pick, robot_arms(scenario)
    time, mode = log["time"], log["mode"].astype(int)
    poses = log.get(pose_key(pick))
    placed, error, tilt, turn = False, None, None, None
    off_table = measures.off_table(scenario, log)
    localization = shift = drift = peak = cycle = lifted = to_placement = end = None
    if poses is not None:
        final = row_to_pose(poses[-1])
        first = 0  # row at which the object was first found
        if status.localization is not None:
            first = int(np.searchsorted(time, status.localized_at - 1e-9))
            localization = status.localization.position - poses[first, :3]
            shape = simple_shape(pick, scenario.objects[pick])
            if shape is not None:
                found = status.localization.X_WO.rotation()
                turn = turn_between(shape, found, row_to_pose(poses[first]).rotation())
        start = row_to_pose(poses[first])
        goal = final_pose(scenario, start)
        if pick not in off_table:
            error = final.translation() - goal.translation()
            tilt = final_tilt(scenario, start, final)
        end = measures.end_error(scenario, final)
        placed = (
            error is not None
            and is_placed(scenario, start, time, poses, touching)
            and measures.is_home(scenario, log)
        )
        lifted = measures.grasp_lifted(mode, poses)
        shift = measures.grasp_shift(mode, poses)
        drift = measures.hold_drift(scenario, time, mode, log, poses)
        peak = float(np.max(log["contact_force"])) or None  # None without contact
    if status.done:
        done = time[mode == MODES.index(Mode.DONE)][0]
        cycle = float(done - status.localized_at) / max(status.cycles, 1)
    opened = measures.placed_at(time, mode)
    if status.cycles == 1 and opened is not None:
        to_placement = opened - status.localized_at
    success = placed and status.done
    cleared, others = None, measures.others_moved(log, pick)
    # The log of real hardware has neither true places of objects nor contacts.
    if scenario.task.clear is not None and "contact_force" in log:
        cleared = clearing_outcome(scenario, log, status)
        peak = float(np.max(log["contact_force"])) or None
        home = measures.is_home(scenario, log)
        others = cleared.others_moved
        success = status.done and home and cleared.report_is_true
    failure = status.failure
    if status.done and not success:
        failure = Failure.MISPLACED
    elif not status.ended:
        failure = Failure.TIME_BUDGET
    return Metrics(
        scenario=name,
        seed=scenario.random_seed,
        success=success,
        failure=failure.value if failure else None,
        attempts=status.attempts,
        cycles=status.cycles,
        cycle_time_s=cycle,
        time_to_placement_s=to_placement,
        planning_wall_s=times.planning,
        localization_error_m=_floats(localization),
        localization_turn_rad=turn,
        placement_error_m=_floats(error),
        placement_tilt_rad=tilt,
        grasp_lifted=lifted,
        grasp_shift_m=shift,
        smoothness=measures.smoothness(time, mode, measures.arm_states(log, arms)),
        hold_drift_m_per_s=drift,
        peak_contact_force_n=peak,
        others_moved_m=others,
        sim_time_s=times.simulated,
        wall_time_s=times.wall,
        real_time_factor=times.simulated / times.wall,
        artifacts=artifacts,
        safety_stops=measures.safety_stops(log, arms),
        floor_gap_m=None if end is None else float(end[2]),
        hole_force_n=measures.hole_force(log),
        off_table=off_table or None,
        kinds=kinds_of(scenario) or None,
        min_arm_distance_m=min_arm_distance(scenario, log),
        arm_contacts=count_arm_contacts(log),
        internal_force_n=largest_internal_force(log),
        max_tilt_deg=carried_tilt(log, pick),
        **({} if cleared is None else cleared.metrics()),
    )


def _at_goal(
    scenario: Scenario, error: Vector, tilt: float | None, end: Vector | None
) -> bool:
    """Return whether an object is where it belongs.

    Args:
        scenario: The scenario.
        error: Error of its position, shape (3,) [m].
        tilt: Tilt from its goal [rad]; None if it has no upright.
        end: See `measures.end_error` [m]; None: not a peg.
    """
    if end is not None and isinstance(scenario.planner, Insert):
        inside = bool(np.linalg.norm(end[:2]) <= _INSIDE)
        return inside and abs(end[2]) <= _SEATED
    tolerance = scenario.task.place.tolerance
    near = bool(np.linalg.norm(error) <= tolerance)
    return near and (tilt is None or tilt <= _MAX_TILT)


def is_placed(
    scenario: Scenario,
    start: RigidTransform,
    time: Vector,
    poses: Vector,
    touching: Collection[str],
) -> bool:
    """Return whether the picked object rests at its goal and touches only its support.

    Args:
        scenario: The scenario.
        start: Pose at which the object was first found, X_WO [m].
        time: Times of the samples (K) [s].
        poses: Poses of the object at these times, shape (K, 7), see `pose_to_row`.
        touching: Names of the bodies that touch it at the end; see `calc_metrics`.
    """
    final = row_to_pose(poses[-1])
    error = final.translation() - final_pose(scenario, start).translation()
    tilt = final_tilt(scenario, start, final)
    end = measures.end_error(scenario, final)
    return bool(
        _at_goal(scenario, error, tilt, end)
        and measures.final_speed(time, poses) <= _MAX_SPEED
        and set(touching) == {"support"}
    )


def kinds_of(scenario: Scenario) -> dict[str, str]:
    """Return the kinds of drawn clutter, by the objects' names."""
    return {
        name: config.kind
        for name, config in scenario.objects.items()
        if re.fullmatch(r"clutter_\d+", name) and config.present
    }


def _floats(vector: Vector | None) -> list[float] | None:
    return None if vector is None else [float(x) for x in vector]
