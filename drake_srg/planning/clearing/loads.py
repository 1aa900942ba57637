"""Loads: expectations, what the maps show, and the planner's conclusions."""

from __future__ import annotations

import dataclasses as dc
import enum
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from drake_srg.planning.clearing.destination import BESIDE, EDGE, Destination, Spots
from drake_srg.planning.clearing.maps import fallen, opened, parts
from drake_srg.planning.state_machine import Memory
from drake_srg.types import Failure, HeightMap, Remaining

# At its destination, a load raises the map by at least this share of its volume, and by
# at least this much [m³], which is more than noise. The share is low because the load
# lies differently in the bin: behind a rim, or on or in other loads, which it pushes
# down.
_LEAST_SHARE, _LEAST_VOLUME = 0.2, 5.0e-6
# At most this share of the load's volume rises beside the bin. Parts count as beside if
# more than `_MOST_OUTSIDE` of them lies there: a part that reaches less far over the
# rim has its middle inside, and stays. Where no camera sees beyond the rim, a rise this
# near to the rim and this much higher [m] also counts as beside: a load that leans
# there may hang over the rim and fall.
_MOST_BESIDE, _MOST_OUTSIDE = 0.25, 0.4
_NEAR_RIM, _ABOVE_RIM = 0.05, 0.02
# If at least this share of the load's volume is inside, a rise beside the bin is
# another thing. The passing arm may have pushed it there.
_MAIN_SHARE = 0.5
# A heap loses more volume than the load, because other things settle. The rise in a bin
# is the load if it is at least `_LEAST_WHOLE` [m³], if no more than that rises beside
# the bin, and if the share `_WHOLE` remains after subtracting the falls.
_LEAST_WHOLE, _WHOLE = 1.0e-5, 0.8
# A part is a separate thing if it is larger than `_LEAST_THING` [m³], than the share
# `_LEAST_PART` of the whole rise, and than `_MOVED` times the fall: a thing that was
# pushed aside rises as much as it falls. All things together rise by at most
# `_MOST_RISEN` times the load's volume.
_LEAST_THING, _LEAST_PART, _MOVED, _MOST_RISEN = 1.0e-5, 0.1, 2.0, 1.5
# A load that hangs over a rim is visible at these distances from the rim [m]. Closer,
# the wall also hides the table from a camera above the bin.
_BEYOND = (0.025, 0.04)
# A load that was set down keeps its height within this [m].
_SAME_HEIGHT = 0.015
# A load's volume on maps agrees within this share, unless the load lies on another
# side.
_ALIKE = 0.25
# A cell whose height has changed by less than this [m] still shows the load.
_SAME_PLACE = 0.01


class Verdict(enum.Enum):
    """The planner's conclusion about a load."""

    PENDING = "pending"  # the cameras have not looked for it yet
    ARRIVED = "arrived"  # it is where it belongs, and counts
    DROPPED = "dropped"  # it is not there, and is reported
    NONE = "none"  # neither: there was no load, or it counts for another pick


@dc.dataclass(frozen=True, eq=False, kw_only=True)
class Load:
    """A load, from the grasp to the verdict.

    Attributes:
        destination: Its destination.
        volume: Volume on the map of the table, with whatever is hidden below it [m³].
        height: Height of its top above the table, as it lay there [m].
        core: Volume that has disappeared right at the grasp [m³].
        felt: Whether the fingers felt it until they let go, and the table's map shows
            it gone. The fingers miss some thin things.
        laid: Whether it was set down, or laid in a lane of a bin, not dropped.
        again: Whether it may be a missed load, picked again.
        label: Label on labelled maps; -1: none.
        verdict: The planner's conclusion.
        before: The map of its destination before it came; None until it has arrived.
        after: The map with the load; None until it has arrived.
        several: Whether several separate things have arrived in its place.
    """

    destination: Destination
    volume: float
    height: float
    core: float = 0.0
    felt: bool = True
    laid: bool = False
    again: bool = False
    label: int = -1
    verdict: Verdict = Verdict.PENDING
    before: HeightMap | None = None
    after: HeightMap | None = None
    several: bool = False

    def is_like(self, volume: float) -> bool:
        """Return whether its volume is about that of something on the table [m³]."""
        return abs(self.volume - volume) < _ALIKE * self.volume

    def may_have_left(self, now: HeightMap) -> bool:
        """Return whether most of its place looks different now.

        The load may lie below something else, or it may be gone.
        """
        if self.before is None or self.after is None:
            return False
        came = -fallen(self.before, self.after) > 0.0
        other = ~(np.abs(now.height - self.after.height) < _SAME_PLACE)
        return bool(np.count_nonzero(came & other) > 0.5 * np.count_nonzero(came))

    def has_left(self, now: HeightMap | None) -> bool:
        """Return whether most of the rise at its arrival is gone."""
        if now is None or self.before is None or self.after is None:
            return False
        risen = np.clip(-fallen(self.before, self.after), 0.0, None)
        still = np.clip(-fallen(self.before, now), 0.0, risen)
        return bool(np.sum(still) < 0.5 * np.sum(risen))

    @property
    def report(self) -> Remaining:
        """The report of a dropped load, at the place of its destination."""
        return Remaining(np.array([*self.destination.middle, 0.0]), Failure.DROPPED)


@dc.dataclass
class Loads(Memory):
    """All loads that the hand has released, and the maps of their destinations.

    A load counts only if it is seen at its destination. One that fell out and is picked
    again counts once. Without a camera there, every load that was taken counts.

    Attributes:
        known: The loads, the last one last.
        seen: The latest map of the destinations; None without a camera there.
    """

    known: tuple[Load, ...] = ()
    seen: HeightMap | None = None

    @property
    def pending(self) -> Load | None:
        """The load that was let go last, until the planner has looked for it."""
        last = self.known[-1] if self.known else None
        return last if last and last.verdict is Verdict.PENDING else None

    @property
    def arrived(self) -> int:
        """Number of loads that count as arrived."""
        return sum(load.verdict is Verdict.ARRIVED for load in self.known)

    @property
    def several(self) -> int:
        """Number of loads that arrived as several things."""
        return sum(load.several for load in self.known)

    @property
    def lost(self) -> tuple[Remaining, ...]:
        """Reports of dropped loads that were not seen at their destination."""
        dropped = [o for o in self.known if o.verdict is Verdict.DROPPED]
        return tuple(load.report for load in dropped)

    def filled(self, destination: Destination) -> float:
        """Return the world z up to which a destination may be filled [m].

        The last load, which has not been looked for yet, may lie on top.
        """
        if self.seen is None:
            return -np.inf
        return destination.top(self.seen) + self._unseen(destination)

    def spots(self, destination: Destination) -> Spots:
        """Return the spots for loads in a bin; a row has none.

        A bin counts as empty until the first look.
        """
        if destination.rim is None:
            return Spots()
        laid = self.pending is not None and self.pending.laid
        unseen = self._unseen(destination) if laid else 0.0
        return destination.spots(self.seen).raised(unseen)

    def _unseen(self, destination: Destination) -> float:
        """Return the height of a load that has not been looked for there yet [m]."""
        load = self.pending
        if load is None or load.destination is not destination:
            return 0.0
        return load.height

    def add(self, load: Load) -> None:
        """Add a load that the hand has released, or may have."""
        if self.seen is None:  # then taking it suffices
            counts = load.felt and not load.again
            verdict = Verdict.ARRIVED if counts else Verdict.NONE
            load = dc.replace(load, verdict=verdict)
        self.known = (*self.known, load)

    def look(self, seen: HeightMap) -> bool:
        """Judge by a map of the destinations whether the last load has arrived.

        Args:
            seen: The map.

        Returns:
            Whether it has.
        """
        before, load = self.seen, self.pending
        self.seen = now = seen.completed(before)
        if load is None or before is None:
            return False
        risen = Risen.between(load.destination, before, now)
        self._strike_off_left(load.destination, risen.lost)
        judged = risen.without_settled(load)
        verdict, several = Verdict.NONE, False
        if arrived := risen.shows(judged):
            if load.again:  # withdraw one report, of its own bin
                dropped = self._of(load.destination, Verdict.DROPPED)
                self._conclude(dropped[-1:], Verdict.NONE)
            verdict, several = Verdict.ARRIVED, risen.shows_several(judged)
            load = dc.replace(load, before=before, after=now, several=several)
        elif (load.felt or risen.shows_beside(judged)) and not load.again:
            verdict = Verdict.DROPPED
        self.known = (*self.known[:-1], dc.replace(load, verdict=verdict))
        return arrived

    def _strike_off_left(self, destination: Destination, volume: float) -> None:
        """Stop counting a load that has left the bin, such as a mug on an open finger.

        A load that only topples or moves within the bin keeps its volume there.

        Args:
            destination: The bin.
            volume: Loss of volume in it since the previous map [m³].
        """
        left = [
            load
            for load in self._of(destination, Verdict.ARRIVED)
            if volume > _MAIN_SHARE * load.volume and load.has_left(self.seen)
        ]
        self._conclude(left[:1], Verdict.DROPPED)

    def match_missed(self, destination: Destination, volume: float) -> bool:
        """Return whether a new thing beside a bin may be a missed load.

        It may be if a load was dropped. It may also be a load that counted and has left
        the bin unnoticed: that load then stops counting. If another load now covers its
        place, only a thing of the same volume matches. Without a map of the
        destinations, the new thing always matches.

        Args:
            destination: The bin.
            volume: Volume of the new thing on the map of the table [m³].
        """
        now = self.seen
        if now is None or self._of(destination, Verdict.DROPPED):
            return True
        left = [
            load
            for load in self._of(destination, Verdict.ARRIVED)
            if load.has_left(now) or (load.is_like(volume) and load.may_have_left(now))
        ]
        if not left:
            return False
        nearest = min(left, key=lambda load: abs(load.volume - volume))
        self._conclude([nearest], Verdict.DROPPED)
        return True

    def has_lost(self, volume: float) -> bool:
        """Return whether a load of about this volume [m³] has left a bin."""
        return any(o.is_like(volume) and o.has_left(self.seen) for o in self.known)

    def _of(self, destination: Destination, verdict: Verdict) -> list[Load]:
        """Return the loads with a destination and a verdict."""
        return [
            load
            for load in self.known
            if load.destination is destination and load.verdict is verdict
        ]

    def _conclude(self, loads: Sequence[Load], verdict: Verdict) -> None:
        """Give some of the loads another verdict."""
        self.known = tuple(
            dc.replace(load, verdict=verdict) if load in loads else load
            for load in self.known
        )


@dc.dataclass(frozen=True)
class Risen:
    """Rises between two height maps of a destination and its surroundings.

    Attributes:
        inside: Volume inside, of parts that lie mostly inside [m³].
        net: Volume inside, minus the volume that has fallen there [m³].
        over: Volume outside, of parts that reach over the rim [m³].
        apart: Volume outside, of parts that lie wholly outside [m³].
        left: Volume outside that has fallen [m³].
        top: Median height of the risen cells inside, above the support on which loads
            are set down [m]; None where they are dropped.
        parts: Volumes of the parts inside [m³].
        fell: Volume inside that has fallen [m³].
    """

    inside: float
    net: float
    over: float
    apart: float
    left: float
    top: float | None
    parts: tuple[float, ...]
    fell: float

    @classmethod
    def between(
        cls, destination: Destination, before: HeightMap, after: HeightMap
    ) -> Risen:
        """Return what has risen between two maps.

        Args:
            destination: The destination.
            before: The map before.
            after: The map now.
        """
        risen = -fallen(before, after)
        changed = risen > 0.0
        inside = destination.contains(after)
        beside = destination.contains(after, BESIDE) & ~inside
        if destination.rim is not None:
            low = after.height < destination.rim + _ABOVE_RIM
            beside &= ~(low & destination.contains(after, EDGE))
            hidden = inside & ~low & _hides(destination, after)
            inside, beside = inside & ~hidden, beside | hidden
            # A load across the rim is one part: its ends join above the wall, whose
            # cells were unknown before.
            changed |= np.isnan(before.height) & (after.height > destination.rim)
        away = beside | ~destination.contains(after, BESIDE)
        received, over, apart = [], 0.0, 0.0
        for part in parts(changed, after.resolution):
            outside = np.count_nonzero(part & away)
            if outside <= _MOST_OUTSIDE * np.count_nonzero(part):
                received.append(float(np.sum(risen[part & inside])))
            elif np.any(part & inside):
                over += float(np.sum(risen[part & beside]))
            else:
                apart += float(np.sum(risen[part & beside]))
        area, come = after.resolution**2, after.height[inside & (risen > 0.0)]
        fell = float(np.sum(np.clip(-risen[inside], 0.0, None)))
        top = float(np.median(come)) if len(come) else -np.inf
        place = destination.place
        return cls(
            inside=area * sum(received),
            net=area * float(np.sum(risen[inside])),
            over=area * over,
            apart=area * apart,
            left=area * float(np.sum(np.clip(-risen[beside], 0.0, None))),
            top=None if place is None else top - float(place[2]),
            parts=tuple(area * volume for volume in received),
            fell=area * fell,
        )

    @property
    def lost(self) -> float:
        """Net loss of volume inside [m³]."""
        return max(-self.net, 0.0)

    def without_settled(self, load: Load) -> Load:
        """Return a load without the things that settled around it on the table.

        Suppose the fingers held the load until they let go, and hardly anything else
        moved in the bin or beside it. Then the rise is the load, however much
        disappeared from the table. It must be at least half as large as the volume that
        disappeared right at the grasp.
        """
        least = max(_LEAST_WHOLE, _MAIN_SHARE * load.core)
        whole = self.inside > least and self.net > _WHOLE * self.inside
        whole &= self.over + self.apart + self.left < _LEAST_WHOLE
        if load.felt and whole and self.inside < _LEAST_SHARE * load.volume:
            return dc.replace(load, volume=self.inside)
        return load

    def shows(self, load: Load) -> bool:
        """Return whether a load has arrived at its destination, and not beside it."""
        received, least = self.inside, _LEAST_SHARE * load.volume
        if load.felt:
            # A load that lay over the rim may have been pushed along it.
            missed = max(self.over - self.left, 0.0)
            if self.net < max(_LEAST_VOLUME, _MAIN_SHARE * load.volume):
                missed += self.apart
        else:
            missed = self.over + self.apart
            # Things in a bin move when a load comes in. If none comes in, as much falls
            # as rises, including parts that are too small to count.
            least = max(least, _LEAST_SHARE * received)
            received = min(received, self.net)
        if received < max(_LEAST_VOLUME, least):
            return False
        if missed > max(_LEAST_VOLUME, _MOST_BESIDE * load.volume):
            return False
        return self.top is None or abs(self.top - load.height) < _SAME_HEIGHT

    def shows_several(self, load: Load) -> bool:
        """Return whether a load has arrived as several separate things."""
        least = max(_LEAST_THING, _LEAST_PART * self.inside, _MOVED * self.fell)
        things = sum(volume > least for volume in self.parts)
        return things > 1 and self.inside < _MOST_RISEN * load.volume

    def shows_beside(self, load: Load) -> bool:
        """Return whether most of a load lies beside its destination."""
        missed = self.over + self.apart - self.left
        least = max(_LEAST_VOLUME, _MAIN_SHARE * load.volume)
        return load.volume > 0.0 and missed > least


def _hides(destination: Destination, after: HeightMap) -> npt.NDArray[np.bool_]:
    """Return the cells near the rim that may hide a load hanging over it."""
    nearest, farthest = _BEYOND
    beyond = destination.contains(after, farthest) & ~destination.contains(
        after, nearest
    )
    unseen = opened(beyond & np.isnan(after.height)).astype(np.uint8)
    size = 2 * round((farthest + _NEAR_RIM) / after.resolution) + 1
    near = cv2.dilate(unseen, np.ones((size, size), np.uint8)) > 0
    return np.asarray(near & ~destination.contains(after, -_NEAR_RIM))
