"""Loads: what is expected of them, what maps show, and what the planner concludes."""

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

# Where a load goes, at least this share of its volume rises, and at least this much
# [m³], which is more than noise. The share is low because the load lies differently
# in the bin: behind a rim, on other loads or in them, and it pushes them down.
_LEAST_SHARE, _LEAST_VOLUME = 0.2, 5.0e-6
# At most this share of the load's volume rises beside the bin, counting parts of
# which more than `_MOST_OUTSIDE` lies there. A part that reaches less far over the
# rim has its middle inside, and stays. Where no camera sees beyond the rim, a rise
# this near to it and this much higher [m] counts as beside, too: a load that leans
# there may hang over it and fall.
_MOST_BESIDE, _MOST_OUTSIDE = 0.25, 0.4
_NEAR_RIM, _ABOVE_RIM = 0.05, 0.02
# If at least this share of the load's volume is inside, a rise beside the bin is
# another thing: an arm that goes by may push things there.
_MAIN_SHARE = 0.5
# A heap loses more than the load, because others settle. If at least this much rises
# in a bin [m³], at most this much rises beside it, and this share remains after
# subtracting the falls, the rise is the load.
_LEAST_WHOLE, _WHOLE = 1.0e-5, 0.8
# A part is a thing of its own if it is larger than this [m³], than this share of the
# whole rise, and than so many times the fall: a thing that was pushed aside rises as
# much as it falls. All things together rise by at most so many times the load's
# volume.
_LEAST_THING, _LEAST_PART, _MOVED, _MOST_RISEN = 1.0e-5, 0.1, 2.0, 1.5
# A load that hangs over a rim shows at these distances from it [m]. Nearer to it, a
# wall hides the table from a camera above the bin, too.
_BEYOND = (0.025, 0.04)
# A load that was set down has kept its height, within [m].
_SAME_HEIGHT = 0.015
# The volume of a load on a map is the same within this share, unless it lies on another
# side.
_ALIKE = 0.25
# A cell of a load that is within this height of where it was still shows it [m].
_SAME_PLACE = 0.01


class Verdict(enum.Enum):
    """The planner's conclusion about a load."""

    PENDING = "pending"  # the cameras have not looked for it yet
    ARRIVED = "arrived"  # it is where it belongs, and counts
    DROPPED = "dropped"  # it is not there, and is reported
    NONE = "none"  # neither: there was none, or it counts as another pick's


@dc.dataclass(frozen=True, eq=False, kw_only=True)
class Load:
    """A load from the grasp to the verdict on it.

    Attributes:
        destination: Where it belongs.
        volume: On the map of the table, with whatever is hidden below it [m³].
        height: Height of its top above the table, as it lay there [m].
        core: Volume that is gone from right at the grasp [m³].
        felt: Whether the fingers felt it until they let go, and the table's map shows
            it gone. The fingers miss some thin things.
        laid: Whether it was set down, or laid in a lane of a bin, not dropped.
        again: Whether it passes for a load that is missed.
        label: On labelled maps; -1: none.
        verdict: Its fate, if known.
        before: The map of where loads go before it came; None until it has arrived.
        after: The map with it; the same.
        several: Whether it has come as several things that lie apart.
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
        """Return whether it is about as large as something on the table [m³]."""
        return abs(self.volume - volume) < _ALIKE * self.volume

    def may_have_left(self, now: HeightMap) -> bool:
        """Return whether most of where it came to lie looks otherwise by now.

        It may lie below something else, or that may be all that is there.
        """
        if self.before is None or self.after is None:
            return False
        came = -fallen(self.before, self.after) > 0.0
        other = ~(np.abs(now.height - self.after.height) < _SAME_PLACE)
        return bool(np.count_nonzero(came & other) > 0.5 * np.count_nonzero(came))

    def has_left(self, now: HeightMap | None) -> bool:
        """Return whether most of what had risen as it came is gone from there."""
        if now is None or self.before is None or self.after is None:
            return False
        risen = np.clip(-fallen(self.before, self.after), 0.0, None)
        still = np.clip(-fallen(self.before, now), 0.0, risen)
        return bool(np.sum(still) < 0.5 * np.sum(risen))

    @property
    def report(self) -> Remaining:
        """The report of a load that was dropped; the place is its destination's."""
        return Remaining(np.array([*self.destination.middle, 0.0]), Failure.DROPPED)


@dc.dataclass
class Loads(Memory):
    """All loads that the hand has let go, and the maps of where they went.

    A load that is not seen where it belongs does not count, and one that fell out
    counts once. Without a camera there, whatever was taken counts.

    Attributes:
        known: The loads, the last one last.
        seen: The latest map of where loads go; None without a camera there.
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
        """Number of loads that have come as several things."""
        return sum(load.several for load in self.known)

    @property
    def lost(self) -> tuple[Remaining, ...]:
        """Reports of the loads that were dropped and not seen where they belong."""
        dropped = [o for o in self.known if o.verdict is Verdict.DROPPED]
        return tuple(load.report for load in dropped)

    def filled(self, destination: Destination) -> float:
        """Return the world z up to which a destination may be filled [m].

        The load that was let go last has not been looked for yet: it may lie on top.
        """
        if self.seen is None:
            return -np.inf
        return destination.top(self.seen) + self._unseen(destination)

    def spots(self, destination: Destination) -> Spots:
        """Return where loads are laid or set down in a bin; a row has no such places.

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
        """Add a load that the hand has let go, or may have."""
        if self.seen is None:  # then it suffices to have taken it
            counts = load.felt and not load.again
            verdict = Verdict.ARRIVED if counts else Verdict.NONE
            load = dc.replace(load, verdict=verdict)
        self.known = (*self.known, load)

    def look(self, seen: HeightMap) -> bool:
        """Judge by a map of where loads go whether the last one has come there.

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
        """Count a load no more that has left the bin, as a mug does on open fingers.

        What only topples, or comes to lie elsewhere in the bin, takes up as much there.

        Args:
            destination: The bin.
            volume: By how much less is in it than on the map before [m³].
        """
        left = [
            load
            for load in self._of(destination, Verdict.ARRIVED)
            if volume > _MAIN_SHARE * load.volume and load.has_left(self.seen)
        ]
        self._conclude(left[:1], Verdict.DROPPED)

    def match_missed(self, destination: Destination, volume: float) -> bool:
        """Return whether what has come to lie beside a bin passes for a missed load.

        Something else may have rolled there, unless a load is missed. One may have left
        the bin unnoticed, as another came in: it counts no more then. If that lies
        where it was, only a thing of the same volume is taken for it. Without a map of
        where loads go, one always may be missed.

        Args:
            destination: The bin.
            volume: Volume of what lay beside it, on the map of the table [m³].
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
        """Return whether a load as large as something on the table [m³] has left."""
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
        inside: Volume inside, of parts that are there for the most part [m³].
        net: Volume inside, less what has fallen there [m³].
        over: Volume outside, of parts that reach over the rim [m³].
        apart: Volume outside, of parts that are wholly there [m³].
        left: Volume outside that has fallen [m³].
        top: Median height of the cells that have risen inside, above what loads are set
            down on [m]; None where they are dropped.
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
            destination: Where loads belong.
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
            # Both ends of a load on the rim are one part, above the strip
            # that the wall hides.
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
        """By how much less is inside than before, on the whole [m³]."""
        return max(-self.net, 0.0)

    def without_settled(self, load: Load) -> Load:
        """Return a load without what has settled around it on the table.

        If the fingers held it until they let go, and hardly anything else has moved in
        the bin or beside it, what has risen is the load, however much is gone from the
        table. It is at least half as large as what is gone from right at the grasp.
        """
        least = max(_LEAST_WHOLE, _MAIN_SHARE * load.core)
        whole = self.inside > least and self.net > _WHOLE * self.inside
        whole &= self.over + self.apart + self.left < _LEAST_WHOLE
        if load.felt and whole and self.inside < _LEAST_SHARE * load.volume:
            return dc.replace(load, volume=self.inside)
        return load

    def shows(self, load: Load) -> bool:
        """Return whether a load has come where it belongs, and not beside."""
        received, least = self.inside, _LEAST_SHARE * load.volume
        if load.felt:
            # A load that lay over the rim may have been pushed along it.
            missed = max(self.over - self.left, 0.0)
            if self.net < max(_LEAST_VOLUME, _MAIN_SHARE * load.volume):
                missed += self.apart
        else:
            missed = self.over + self.apart
            # Things in a bin move as a load comes in. If none comes in,
            # as much falls as rises, also in parts that are too small to
            # count.
            least = max(least, _LEAST_SHARE * received)
            received = min(received, self.net)
        if received < max(_LEAST_VOLUME, least):
            return False
        if missed > max(_LEAST_VOLUME, _MOST_BESIDE * load.volume):
            return False
        return self.top is None or abs(self.top - load.height) < _SAME_HEIGHT

    def shows_several(self, load: Load) -> bool:
        """Return whether a load has come as several things that lie apart."""
        least = max(_LEAST_THING, _LEAST_PART * self.inside, _MOVED * self.fell)
        things = sum(volume > least for volume in self.parts)
        return things > 1 and self.inside < _MOST_RISEN * load.volume

    def shows_beside(self, load: Load) -> bool:
        """Return whether most of a load has come to lie beside where it belongs."""
        missed = self.over + self.apart - self.left
        least = max(_LEAST_VOLUME, _MAIN_SHARE * load.volume)
        return load.volume > 0.0 and missed > least


def _hides(destination: Destination, after: HeightMap) -> npt.NDArray[np.bool_]:
    """Return which cells near the rim may belong to what hangs over it unseen."""
    nearest, farthest = _BEYOND
    beyond = destination.contains(after, farthest) & ~destination.contains(
        after, nearest
    )
    unseen = opened(beyond & np.isnan(after.height)).astype(np.uint8)
    size = 2 * round((farthest + _NEAR_RIM) / after.resolution) + 1
    near = cv2.dilate(unseen, np.ones((size, size), np.uint8)) > 0
    return np.asarray(near & ~destination.contains(after, -_NEAR_RIM))
