"""Outcome of a run that clears a table, from the ground truth in its log."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import cv2
import numpy as np

from drake_srg.common.log_format import MODES, pose_key, row_to_pose
from drake_srg.common.srg_geometry import SRG
from drake_srg.objects.household import ObjectFacts, object_facts
from drake_srg.objects.models import simple_shape
from drake_srg.scenario import RobotArm, Scenario, robot_arms
from drake_srg.simulation import measures
from drake_srg.simulation.measures import hand_poses
from drake_srg.station.perception import ROW, bin_boxes, destinations, row_places
from drake_srg.types import Failure, Mode, PlannerStatus, Remaining, Sphere, Vector

# Point midway between the fingers, in the palm's frame [m].
_p_GC = np.array([SRG.grasp_center_x, 0.0, 0.0])
# Least rise of the middle of an object that counts as carried [m].
_LIFTED = 0.08


def attempts_of(
    scenario: Scenario, log: Mapping[str, Vector], facts: Mapping[str, ObjectFacts]
) -> dict[str, int]:
    """Return the number of grasps at which the hand was nearest to each object."""
    counts = dict.fromkeys(facts, 0)
    if not facts:  # there may be grasps nevertheless, at a mistaken colour
        return counts
    for arm in robot_arms(scenario):
        states = measures.arm_states(log, [arm])
        assert states is not None
        closes = arm_modes(log, arm) == MODES.index(Mode.CLOSE)
        rows = np.flatnonzero(closes[1:] & ~closes[:-1]) + 1
        for row, X_WG in zip(
            rows, hand_poses(scenario, states[rows], arm), strict=True
        ):
            distances = {
                name: box_distance(log[pose_key(name)][row], facts[name], X_WG @ _p_GC)
                for name in facts
            }
            counts[min(distances, key=lambda name: distances[name])] += 1
    return counts


def arm_modes(log: Mapping[str, Vector], arm: RobotArm) -> Vector:
    """Return the modes of an arm's planner, one per sample; see `MODES`."""
    return log.get(f"{arm.prefix}mode", log["mode"])


def loads_carried(
    scenario: Scenario, log: Mapping[str, Vector], facts: Mapping[str, ObjectFacts]
) -> list[list[str]]:
    """Return the names of the objects that each grasp carried until its transfer ended.

    These are the objects that are then at least 8 cm higher than when the fingers
    closed. With several arms, the arm whose hand is nearest carries an object.

    Args:
        scenario: The scenario.
        log: Arrays of log.npz, with the poses of all objects.
        facts: Facts about the objects, by name.
    """

    def middle(name: str, row: np.integer[Any]) -> Vector:
        p_O = 0.5 * (facts[name].low + facts[name].high)
        p_W: Vector = row_to_pose(log[pose_key(name)][row]) @ p_O
        return p_W

    arms, loads = robot_arms(scenario), []
    for arm in arms:
        mode = arm_modes(log, arm)
        closes, moves = (mode == MODES.index(m) for m in (Mode.CLOSE, Mode.TRANSFER))
        begun = np.flatnonzero(closes[1:] & ~closes[:-1]) + 1
        for end in np.flatnonzero(moves[:-1] & ~moves[1:]):
            before = begun[begun < end]
            if not len(before):
                continue
            rose = [
                name
                for name in facts
                if middle(name, end)[2] - middle(name, before[-1])[2] > _LIFTED
            ]
            if len(arms) > 1:
                hands = _hands(scenario, log, end)
                rose = [n for n in rose if _nearest(hands, middle(n, end)) == arm.name]
            loads.append((end, rose))
    return [load for _, load in sorted(loads, key=lambda item: item[0])]


def _hands(
    scenario: Scenario, log: Mapping[str, Vector], row: np.integer[Any]
) -> dict[str, Vector]:
    """Return the points midway between the fingers in world, shape (3,), by arm [m]."""
    hands = {}
    for arm in robot_arms(scenario):
        states = measures.arm_states(log, [arm])
        assert states is not None
        (X_WG,) = hand_poses(scenario, states[[row]], arm)
        hands[arm.name] = X_WG @ _p_GC
    return hands


def _nearest(hands: Mapping[str, Vector], p_W: Vector) -> str:
    return min(hands, key=lambda name: float(np.linalg.norm(hands[name] - p_W)))


def delivered(loads: Sequence[Collection[str]], cleared: Collection[str]) -> int:
    """Return the number of grasps that took an object to its final place.

    An object that was carried several times counts only for the last grasp.

    Args:
        loads: Names of the objects that each grasp carried, in order of grasps.
        cleared: Names of the objects that rest where they belong.
    """
    left = set(cleared)
    count = 0
    for load in reversed(loads):
        count += not left.isdisjoint(load)
        left.difference_update(load)
    return count


def box_distance(row: Vector, facts: ObjectFacts, p_W: Vector) -> float:
    """Return the distance of a point from the box around an object [m]."""
    p_O = row_to_pose(row).inverse() @ p_W
    outside = np.maximum(np.maximum(facts.low - p_O, p_O - facts.high), 0.0)
    return float(np.linalg.norm(outside))


# Greatest height above the rim of the middle of an object that rests on others in the
# bin [m], such as a block that stands on a box, each 0.2 m long.
_HEAPED = 0.2
# Greatest depth below the bin of an object's middle [m].
_BELOW = 0.01
_UPRIGHT = np.cos(np.deg2rad(5.0))  # of an object's largest lean when it stands
# Largest distance between an object and the place that the planner reports for it [m].
_NAMED_WITHIN = 0.05
CLEARED, WRONG_BIN = "cleared", "wrong_bin"


@dc.dataclass(frozen=True)
class ObjectOutcome:
    """Outcome for one object.

    Attributes:
        cleared: Whether it rests in its bin.
        outcome: `cleared`, `wrong_bin` if it rests in another bin, or the planner's
            reason for leaving it: `dropped` if it was released and not seen in its bin,
            `not_seen` if the planner gives no reason.
        attempts: Grasps at which the hand was nearest to it.
        width_m: Least distance of two parallel vertical planes that enclose it, before
            the first pick [m].
        lay_at_m: x, y of its middle in world, before the first pick [m].
        moved_m: Distance of its middle from that place at the end [m].
        under: Name of another object that lies over its middle at the end, or "".
        carried_with: Name of another object that the hand carried with it last, or "".
    """

    cleared: bool
    outcome: str
    attempts: int
    width_m: float
    lay_at_m: tuple[float, float]
    moved_m: float
    under: str = ""
    carried_with: str = ""


@dc.dataclass(frozen=True)
class ClearingOutcome:
    """Outcome for all objects.

    Attributes:
        objects: Outcomes of the objects that belong in a bin.
        picks: Grasps begun.
        picks_held: Loads that the planner counts as arrived, at most one per grasp.
        picks_delivered: Grasps whose load rests where it belongs, by ground truth.
        picks_per_hour: `picks_held` per hour.
        multi_object_picks: Picks that carried several objects.
        multi_object_picks_seen: Picks after which the planner saw several objects.
        in_wrong_bin: Names of the objects that rest in a bin in which they do not
            belong.
        others_moved: Largest distance that any object without a bin has moved since the
            first pick was planned [m]; None without picks or such objects.
        bins: Number of bins.
    """

    objects: Mapping[str, ObjectOutcome]
    picks: int
    picks_held: int
    picks_delivered: int
    picks_per_hour: float | None
    multi_object_picks: int = 0
    multi_object_picks_seen: int = 0
    in_wrong_bin: tuple[str, ...] = ()
    others_moved: float | None = None
    bins: int = 1

    @property
    def cleared(self) -> int:
        """Number of objects in their bin."""
        return sum(thing.cleared for thing in self.objects.values())

    def metrics(self) -> dict[str, Any]:
        """Return the entries of metrics.json."""
        sorting = self.bins > 1
        return {
            "objects_total": len(self.objects),
            "objects_cleared": self.cleared,
            "objects_sorted": self.cleared if sorting else None,
            "objects_in_wrong_bin": len(self.in_wrong_bin) if sorting else None,
            "picks": self.picks,
            "picks_held": self.picks_held,
            "picks_delivered": self.picks_delivered,
            "picks_per_hour": self.picks_per_hour,
            "multi_object_picks": self.multi_object_picks,
            "multi_object_picks_seen": self.multi_object_picks_seen,
            "objects": {name: dc.asdict(o) for name, o in self.objects.items()},
        }

    @property
    def report_is_true(self) -> bool:
        """Whether the planner's report matches the ground truth."""
        lost = (Failure.NOT_SEEN.value, Failure.DROPPED.value)
        named = all(
            thing.cleared or thing.outcome not in lost
            for thing in self.objects.values()
        )
        claimed = self.picks_held <= self.cleared
        return named and claimed and not self.in_wrong_bin


def clearing_outcome(
    scenario: Scenario, log: Mapping[str, Vector], status: PlannerStatus
) -> ClearingOutcome:
    """Return the outcomes of the objects of a scenario with `task.clear`.

    Args:
        scenario: The scenario.
        log: Arrays of log.npz, one row per sample.
        status: The planner's last status.
    """
    assert scenario.task.clear is not None
    time, boxes = log["time"], bin_boxes(scenario)
    wanted = {n: b for n, b in destinations(scenario).items() if pose_key(n) in log}
    names = [name for name, into in wanted.items() if into is not None]
    facts = {name: object_facts(name, scenario.objects[name]) for name in wanted}
    attempts = attempts_of(scenario, log, {name: facts[name] for name in names})
    found = resting_places(scenario, log, facts)
    sorts = not scenario.arms
    if not sorts:  # any bin will do
        wanted = {name: found[name] or into for name, into in wanted.items()}
    modes = [arm_modes(log, arm) for arm in robot_arms(scenario)]
    begins = np.any([m == MODES.index(Mode.PRE_GRASP) for m in modes], axis=0)
    begun = np.flatnonzero(begins)
    first = int(begun[0]) if len(begun) else -1
    outcomes = {}
    for name in names:
        cleared = found[name] == wanted[name]
        if found[name] is None:
            last = log[pose_key(name)][-1]
            outcome = _reason(last, facts[name], status.left)
        else:
            outcome = CLEARED if cleared else WRONG_BIN
        middle = 0.5 * (facts[name].low + facts[name].high)
        X_WO, X_WO_end = (row_to_pose(log[pose_key(name)][i]) for i in (first, -1))
        x, y, _ = X_WO @ middle
        outcomes[name] = ObjectOutcome(
            cleared,
            outcome,
            attempts[name],
            width_m=least_width((X_WO @ facts[name].points.T)[:2].T),
            lay_at_m=(float(x), float(y)),
            moved_m=float(np.linalg.norm(X_WO_end @ middle - X_WO @ middle)),
        )
    for name, above in _covered(log, facts, outcomes).items():
        outcomes[name] = dc.replace(outcomes[name], under=above)
    loads = loads_carried(scenario, log, facts)
    for load in loads:
        for name in load:
            other = next((n for n in load if n != name), "")
            if other and name in outcomes:
                outcomes[name] = dc.replace(outcomes[name], carried_with=other)
    for name in _dropped(log, outcomes, status.left):
        outcomes[name] = dc.replace(outcomes[name], outcome=Failure.DROPPED.value)
    spent = time[-1] - status.localized_at
    ended = np.isin(log["mode"], [MODES.index(m) for m in (Mode.DONE, Mode.FAILED)])
    if ended.any():
        spent = time[np.argmax(ended)] - status.localized_at
    rate = 3600.0 * status.cycles / spent if status.attempts and spent > 0.0 else None
    return ClearingOutcome(
        outcomes,
        status.attempts,
        status.cycles,
        delivered(loads, {name for name, o in outcomes.items() if o.cleared}),
        rate,
        sum(len(load) > 1 for load in loads),
        status.multi_object_picks,
        tuple(n for n, into in found.items() if into not in (None, wanted[n])),
        _others_moved(log, set(wanted) - set(names), status),
        len(boxes) if sorts else 1,
    )


def resting_places(
    scenario: Scenario, log: Mapping[str, Vector], facts: Mapping[str, ObjectFacts]
) -> dict[str, str | None]:
    """Return the bin, or the row, in which each object rests at the end, or None.

    Args:
        scenario: The scenario.
        log: `time` and the poses of the objects.
        facts: Facts about the objects, by name.
    """
    boxes = bin_boxes(scenario)
    found = {
        name: next(
            (
                b
                for b, box in boxes.items()
                if _rests_inside(log, name, facts[name], box)
            ),
            None,
        )
        for name in facts
    }
    for name, p_WO in row_places(scenario).items():
        if name in facts and _stands_at(scenario, log, name, p_WO):
            found[name] = ROW
    return found


def least_width(p: Vector) -> float:
    """Return the least width between parallel lines that enclose points (n, 2)."""
    angles = np.deg2rad(np.arange(0.0, 180.0, 1.0))
    along = p @ np.array([np.cos(angles), np.sin(angles)])
    return float(np.min(along.max(axis=0) - along.min(axis=0)))


def _covered(
    log: Mapping[str, Vector],
    facts: Mapping[str, ObjectFacts],
    outcomes: Mapping[str, ObjectOutcome],
) -> dict[str, str]:
    """Return objects left over that lie under another one, with the other's name."""
    poses = {n: row_to_pose(log[pose_key(n)][-1]) for n, o in outcomes.items()}
    left = [name for name, outcome in outcomes.items() if not outcome.cleared]
    middles = {n: poses[n] @ (0.5 * (facts[n].low + facts[n].high)) for n in left}
    found = {}
    for above in left:
        outline = (poses[above] @ facts[above].points.T)[:2].T.astype(np.float32)
        hull = cv2.convexHull(outline)
        for name in left:
            p_W = middles[name]
            over = cv2.pointPolygonTest(hull, p_W[:2].tolist(), measureDist=False) > 0
            if over and middles[above][2] > p_W[2]:
                found[name] = above
    return found


def _rests_inside(
    log: Mapping[str, Vector],
    name: str,
    facts: ObjectFacts,
    box: tuple[Vector, Vector],
) -> bool:
    poses = log[pose_key(name)]
    slow = measures.final_speed(log["time"], poses) < measures.AT_REST
    # The middle counts, not the origin, which is at the top of a jug upside down.
    middle = 0.5 * (facts.low + facts.high)
    return bool(slow and _is_inside(row_to_pose(poses[-1]) @ middle, box))


def _stands_at(
    scenario: Scenario, log: Mapping[str, Vector], name: str, p_WO: Vector
) -> bool:
    """Return whether an object stands upright at its place in the row."""
    row, poses = scenario.task.place.row, log[pose_key(name)]
    assert row is not None
    X_WO = row_to_pose(poses[-1])
    shape = simple_shape(name, scenario.objects[name])
    middle = X_WO.translation() - p_WO
    return bool(
        measures.final_speed(log["time"], poses) < measures.AT_REST
        and np.linalg.norm(middle[:2]) <= row.tolerance
        and abs(middle[2]) < _BELOW + (0.5 * shape.height if shape else 0.0)
        and (isinstance(shape, Sphere) or X_WO.rotation().matrix()[2, 2] > _UPRIGHT)
    )


def _others_moved(
    log: Mapping[str, Vector], others: Collection[str], status: PlannerStatus
) -> float | None:
    """Return `ClearingOutcome.others_moved`."""
    if not (others and status.attempts):
        return None
    first = int(np.searchsorted(log["time"], status.localized_at - 1e-9))
    places = [log[pose_key(name)][first:, :3] for name in sorted(others)]
    moved = [np.linalg.norm(p - p[0], axis=1).max() for p in places]
    return float(max(moved))


def _is_inside(p_W: Vector, box: tuple[Vector, Vector]) -> bool:
    low, high = box[0] - [0.0, 0.0, _BELOW], box[1] + [0.0, 0.0, _HEAPED]
    return bool(np.all(p_W >= low) and np.all(p_W <= high))


def _reason(row: Vector, facts: ObjectFacts, left: Sequence[Remaining]) -> str:
    """Return the planner's reason for leaving an object, found by its place."""
    distances = [(box_distance(row, facts, thing.p_W), thing) for thing in left]
    near = [pair for pair in distances if pair[0] < _NAMED_WITHIN]
    if not near:
        return Failure.NOT_SEEN.value
    return min(near, key=lambda pair: pair[0])[1].failure.value


def _dropped(
    log: Mapping[str, Vector],
    outcomes: Mapping[str, ObjectOutcome],
    left: Sequence[Remaining],
) -> list[str]:
    """Return the objects that must be the dropped loads.

    Among the objects for which the planner gives no reason, they are the nearest to
    the places of dropped loads, as many as there are such places.
    """
    lost = [thing.p_W for thing in left if thing.failure is Failure.DROPPED]
    unnamed = [n for n, o in outcomes.items() if o.outcome == Failure.NOT_SEEN.value]

    def distance(name: str) -> float:
        return min(float(np.linalg.norm(log[pose_key(name)][-1, :3] - p)) for p in lost)

    return sorted(unnamed, key=distance)[: len(lost)] if lost else []
