"""Whether height maps show that a load has come where it belongs."""

from __future__ import annotations

import dataclasses as dc

import cv2
import numpy as np
import numpy.typing as npt

from drake_srg.planning.clearing.comparing import fallen, opened, parts
from drake_srg.planning.clearing.destination import BESIDE, EDGE, Destination
from drake_srg.types import HeightMap

# Where loads go, at least this share of their volume rises, and at least so much [m³]:
# more than noise. Things lie differently there, behind a rim, on others and in them,
# and push others down.
_LEAST_SHARE, _LEAST_VOLUME = 0.2, 5.0e-6
# At most this share of the load's volume rises beside, in parts of which more than
# `_MOST_OUTSIDE` lies there: what reaches less far over the rim has its middle inside,
# and stays. So near to the rim, and so much higher than it [m], is beside, too,
# where no camera sees beyond it: a load that leans there may hang over it and fall.
_MOST_BESIDE, _MOST_OUTSIDE = 0.25, 0.4
_NEAR_RIM, _ABOVE_RIM = 0.05, 0.02
# If at least this share of its volume has come in on the whole, what has come to lie
# beside is something else: an arm that goes by may push things there.
MAIN_SHARE = 0.5
# What a heap loses is more than the load: others settle. Where at least so much rises
# in a bin [m³], as little beside it, and so little falls that this share remains, it is
# the load.
_LEAST_WHOLE, _WHOLE = 1.0e-5, 0.8
# A part is a thing of its own if it is larger than this [m³], than this share of all
# that has risen, and than so many times what has fallen: what was pushed aside rises as
# much as it falls. Things rise by so many times the load's volume together at most.
_LEAST_THING, _LEAST_PART, _MOVED, _MOST_RISEN = 1.0e-5, 0.1, 2.0, 1.5
# What hangs over a rim shows at these distances from it [m]. Nearer to it, a wall hides
# the table from a camera above the bin, too.
_BEYOND = (0.025, 0.04)
# What was set down is as high as it was, within [m].
_SAME_HEIGHT = 0.015


@dc.dataclass(frozen=True)
class SeenLoad:
    """A load as it was seen on the table."""

    volume: float  # m³, with whatever is hidden below it
    height: float  # of its top above the table [m]
    # Whether the fingers felt it until they let go, and the table's map shows it gone.
    # The fingers miss some thin things.
    felt: bool = True
    core: float = 0.0  # volume that is gone from right at the grasp [m³]


@dc.dataclass(frozen=True)
class Risen:
    """What has risen between two maps of a destination and of what is around it.

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
            # Both ends of what lies on the rim are one part, above what the wall hides.
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
        return cls(
            inside=area * sum(received),
            net=area * float(np.sum(risen[inside])),
            over=area * over,
            apart=area * apart,
            left=area * float(np.sum(np.clip(-risen[beside], 0.0, None))),
            top=None if destination.level is None else top - destination.level,
            parts=tuple(area * volume for volume in received),
            fell=area * fell,
        )

    @property
    def lost(self) -> float:
        """By how much less is inside than before, on the whole [m³]."""
        return max(-self.net, 0.0)

    def without_settled(self, load: SeenLoad) -> SeenLoad:
        """Return a load without what has settled around it on the table.

        If the fingers held it until they let go, and hardly anything else has moved in
        the bin or beside it, what has risen is the load, however much is gone from the
        table. It is at least half as large as what is gone from right at the grasp.
        """
        least = max(_LEAST_WHOLE, MAIN_SHARE * load.core)
        whole = self.inside > least and self.net > _WHOLE * self.inside
        whole &= self.over + self.apart + self.left < _LEAST_WHOLE
        if load.felt and whole and self.inside < _LEAST_SHARE * load.volume:
            return dc.replace(load, volume=self.inside)
        return load

    def shows(self, load: SeenLoad) -> bool:
        """Return whether a load has come where it belongs, and not beside."""
        received, least = self.inside, _LEAST_SHARE * load.volume
        if load.felt:
            # What lay over the rim may have been pushed along it.
            missed = max(self.over - self.left, 0.0)
            if self.net < max(_LEAST_VOLUME, MAIN_SHARE * load.volume):
                missed += self.apart
        else:
            missed = self.over + self.apart
            # What lies in a bin moves as a load comes in; without one, as much falls,
            # also in parts that are too small to count.
            least = max(least, _LEAST_SHARE * received)
            received = min(received, self.net)
        if received < max(_LEAST_VOLUME, least):
            return False
        if missed > max(_LEAST_VOLUME, _MOST_BESIDE * load.volume):
            return False
        return self.top is None or abs(self.top - load.height) < _SAME_HEIGHT

    def shows_several(self, load: SeenLoad) -> bool:
        """Return whether a load has come as several things that lie apart."""
        least = max(_LEAST_THING, _LEAST_PART * self.inside, _MOVED * self.fell)
        things = sum(volume > least for volume in self.parts)
        return things > 1 and self.inside < _MOST_RISEN * load.volume

    def shows_beside(self, load: SeenLoad) -> bool:
        """Return whether most of a load has come to lie beside where it belongs."""
        missed = self.over + self.apart - self.left
        least = max(_LEAST_VOLUME, MAIN_SHARE * load.volume)
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
