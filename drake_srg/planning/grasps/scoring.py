"""Scores of grasps from above on a height map, many at a time."""

from __future__ import annotations

import abc
import dataclasses as dc
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from drake_srg.planning.grasps.fingers import Fingers, Wrap
from drake_srg.planning.grasps.segmentation import Segmentation, Thing
from drake_srg.types import Vector

Floats = npt.NDArray[np.float32]

# Distance that the open hand keeps from everything [m].
_CLEARANCE = 0.004
# A thing counts as between the fingers if it rises above their ends by this [m].
_ENGAGED = 0.002
# Half gaps of the open fingers' ends to try for pinches [m].
_OPENINGS = (0.016, 0.027, 0.04, 0.055, 0.07, 0.085)
# Depths of the fingers' ends below the top of a thing to try for pinches [m], but not
# below the table. In noisy maps, a shallower grasp has no flank to hold: 7 mm down the
# rim of a plate, pinches slip off.
_DEPTHS = (0.015, 0.03, 0.045, 0.06, 0.08, 0.095)
# A thing this near to a pad touches it [m].
_TOUCHES = 0.004
# The slant of a face is fitted across the pad to the surface within `_FACE` of the
# middle of the part that touches. Distances beyond `_AWAY` count as that [m].
_FACE, _AWAY = 0.01, 0.02
# Height of the flank over which its lean is measured [m].
_RISE = 0.012
# A low thing may have most of its flank below the limit for things between the pads.
# Its flank begins `_FOOT` above the fingers' ends [m], or `_DEVIATIONS` standard
# deviations of the table's own heights if that is higher.
_FOOT, _DEVIATIONS = 0.001, 2.0
# Greatest tangent of the angle between a face and the pad that presses on it. Friction
# would allow 0.6, but blurred edges look less steep than they are.
STEEPEST = 0.45
# Weights of the score's terms (docs/grasps.md): twist, wedge, lever [1/m].
_TWIST, _WEDGE, _LEVER = 2.0, 2.0, 48.0
# With a friction of 0.6, a lying squeeze bottle of 0.575 kg is held with levers of up
# to 10 mm. With any longer lever, it swings. So the cost grows only up to `_LONGEST`.
# An unknown lever costs as much as `_UNKNOWN` [m].
_LONGEST, _UNKNOWN = 0.05, 0.017
# A thing that sticks out along the closing direction tips between the pads. Their
# friction and pressure resist by N (mu w + h), if they are w apart and h high. Up to
# `_RESISTED` times (mu w + h), the distance of the middle costs nothing. Each further
# multiple costs a point; together with the lever, at most as much as the longest lever.
# A hammer held by its head has 3.9 and falls; a bowl held by its wall has 1.1.
_FRICTION, _RESISTED = 0.6, 1.5
# Greatest distance between samples below the palm [m].
_PALM_STEP = 0.007
# Samples reach this far beyond the edges of the pads, for errors of the map [m].
_EDGES = 0.002
# More room than `_ROOM` around the open hand is no better [m]. Things wider than
# `_WIDE` are harder to hold [m].
_ROOM, _WIDE = 0.012, 0.1
# Weights of the score's terms (docs/grasps.md): depth, steepness, the excess width that
# costs two points, and the half gap that costs one point [m].
_DEPTH, _STEEP, _EXCESS, _OPENING = 2.5, 2.0, 0.05, 0.3
# Half the width of a pinch's middle, where the hand takes the thing. The middle counts
# as one thing up to `_TALLER` above its central point [m].
_MIDDLE, _TALLER = 0.011, 0.02
# Samples reach this far beyond the widest opening, for the fingers' backs [m].
_BACKS = 0.04
# The tips press on a thing's sides within this of its top [m].
_EDGE = 0.02
# Greatest apparent width of steep sides on a map [m].
_BLURRED = 0.012
# Largest distance of the thing's middle from the palm's, along the closing direction
# [m].
_CENTERED = 0.008
# Distance from a thing's middle at which wraps are tried [m], and number of directions.
_BESIDE, _YAWS = 0.03, 36


def extent(
    mask: npt.NDArray[np.bool_], s: Vector
) -> tuple[Vector, Vector, npt.NDArray[np.bool_]]:
    """Return the first and last set offset of a mask (..., S), and whether any is."""
    some = np.asarray(mask.any(axis=-1))
    first = mask.argmax(axis=-1)
    last = len(s) - 1 - mask[..., ::-1].argmax(axis=-1)
    return np.where(some, s[first], 0.0), np.where(some, s[last], 0.0), some


def face_of(distance: Vector, t: Vector) -> tuple[Vector, Vector, Vector]:
    """Return the parts of pads that touch things, and the slopes of the faces.

    Args:
        distance: Distance of things from pads, shape (n, T) [m]; inf without a thing.
        t: Positions across the pad, shape (T,) [m].

    Returns:
        The shares 0 .. 1, the middles in t [m] and the slopes, shape (n,) each.
    """
    touches = distance < _TOUCHES
    middle = (touches * t).sum(axis=1) / np.maximum(touches.sum(axis=1), 1)
    face = np.abs(t - middle[:, None]) < _FACE
    count = np.maximum(face.sum(axis=1), 1)
    dt = t - ((face * t).sum(axis=1) / count)[:, None]
    away = np.clip(distance, 0.0, _AWAY)
    slope = (face * dt * away).sum(axis=1) / (face * dt * dt).sum(axis=1).clip(1e-9)
    return touches.mean(axis=1), middle, slope


def lean_of(
    strip: npt.NDArray[np.float32],
    tip: Vector,
    top: Vector,
    end: Vector,
    inwards: int,
    step: float,
    noise: float = 0.0,
) -> Vector:
    """Return the tangents of the angles by which flanks lean inwards.

    Pads slip off flanks that lean more than friction allows. The lower a hand holds a
    round thing, the less its flanks lean. Low things' flanks count down to their foot.

    Args:
        strip: Heights along the closing direction, shape (n, S) [m].
        tip: Height of the fingers' ends, shape (n,) [m].
        top: Height of the thing, shape (n,) [m].
        end: End of the thing, shape (n,) [m].
        inwards: Direction from the end to the thing's inside, 1 or -1.
        step: Distance between the samples, the middle one of which is at 0 [m].
        noise: Standard deviation of the heights [m].
    """
    rows = np.arange(len(strip))
    rise = np.clip(0.8 * (top - tip), 1e-3, _RISE)
    ends = (strip.shape[1] - 1) // 2 + np.rint(end / step).astype(int)
    run = np.zeros(len(strip))
    steps = np.arange(1, round(_RISE / step) + 1)
    low, foot = np.ones(len(strip), bool), rise < _RISE
    for away in steps:
        inside, outside = (
            strip[rows, np.clip(ends + way * away, 0, strip.shape[1] - 1)]
            for way in (inwards, -inwards)
        )
        low = low & (inside < tip + rise)
        foot = foot & (outside > tip + max(_FOOT, _DEVIATIONS * noise))
        run += step * (low.astype(int) + foot)
    return run / rise


@dc.dataclass(frozen=True, eq=False)
class Candidates:
    """Grasps from above, one per row; impossible ones have the score -inf.

    Attributes:
        p_W: x, y of the palm's axis in world, shape (n, 2) [m].
        yaw: Direction of closing, shape (n,) [rad].
        tip: Height above the table of the lowest point that closing fingers reach,
            shape (n,) [m].
        half_gap: Half of the gap between the open fingers' ends, shape (n,) [m].
        low: Start of the thing along the closing direction, shape (n,) [m].
        high: End of the thing, shape (n,) [m].
        top: Height above the table of the thing between the fingers, shape (n,) [m].
        lean: Tangent of the angle by which its flanks lean inwards, shape (n,).
        score: Higher is better, shape (n,).
    """

    p_W: Vector
    yaw: Vector
    tip: Vector
    half_gap: Vector
    low: Vector
    high: Vector
    top: Vector
    lean: Vector
    score: Vector

    @property
    def direction(self) -> Vector:
        """Unit vectors in which the fingers close, shape (n, 2)."""
        return np.stack([np.cos(self.yaw), np.sin(self.yaw)], axis=-1)

    def take(self, index: npt.NDArray[np.intp]) -> Candidates:
        """Return some of the rows."""
        return Candidates(
            **{f.name: getattr(self, f.name)[index] for f in dc.fields(self)}
        )

    def best(self, count: int) -> Candidates:
        """Return at most `count` possible candidates, the best first."""
        order = np.argsort(-self.score, kind="stable")[:count]
        return self.take(order[np.isfinite(self.score[order])])


class TopGraspJudge(abc.ABC):
    """Judges grasps from above on a height map, many at a time.

    Args:
        fingers: The hand's.
        reach: Reach of the hand from the palm's middle along the closing direction [m].
        table_gap: Height above the table that the ends of closing fingers keep [m].
        step: Distance between samples along the closing direction [m].
        across: The same across it [m].
    """

    def __init__(
        self,
        fingers: Fingers,
        reach: float,
        *,
        table_gap: float,
        step: float,
        across: float,
    ) -> None:
        self._fingers, self._table_gap, self._step = fingers, table_gap, step
        count = int(reach / step)
        self._s: Vector = step * np.arange(-count, count + 1.0)
        half = 0.5 * fingers.pad_width + _EDGES
        self._t = np.linspace(-half, half, 2 * int(np.ceil(half / across)) + 1)

    @abc.abstractmethod
    def judge(self, segments: Segmentation, p_W: Vector, yaw: Vector) -> Candidates:
        """Return the best candidate at or near each place.

        Args:
            segments: The segmented map of the table.
            p_W: x, y of the palm's axis in world, shape (n, 2) [m].
            yaw: Direction of closing, shape (n,) [rad].
        """

    @abc.abstractmethod
    def _floor(self, segments: Segmentation, candidates: Candidates) -> Vector:
        """Return the height above the table from which pads touch a thing, (n,) [m]."""

    def _below_palm(self, segments: Segmentation, p_W: Vector, yaw: Vector) -> Vector:
        """Return the greatest height below the palm at each place, shape (n,) [m]."""
        y, z = (
            np.linspace(-0.5 * size, 0.5 * size, int(size / _PALM_STEP) + 2)
            for size in self._fingers.palm_size
        )
        return sample(segments, p_W, yaw, y, z).max(axis=(1, 2))

    def refine(self, segments: Segmentation, candidates: Candidates) -> Candidates:
        """Return candidates whose scores include the fit of the pads on the thing.

        Pads that touch the thing with a corner, or not opposite to each other, turn it.
        So does its weight if it is held far from its middle.
        """
        if not len(candidates.score):
            return candidates
        heights = sample(segments, candidates.p_W, candidates.yaw, self._s, self._t)
        between = heights > self._floor(segments, candidates)[:, None, None]
        inside = np.abs(self._s) <= candidates.half_gap[:, None]
        low, high, some = extent(between & inside[:, None], self._s)  # (n, T)
        # Distances of the thing from each pad, shape (n, T).
        missing = np.where(some, 0.0, np.inf)
        share_low, middle_low, slope_low = face_of(
            low - candidates.low[:, None] + missing, self._t
        )
        share_high, middle_high, slope_high = face_of(
            candidates.high[:, None] - high + missing, self._t
        )
        width = np.maximum(candidates.high - candidates.low, 0.01)
        twist = np.abs(middle_high - middle_low) / width
        wedge = 0.5 * np.abs(slope_high + slope_low)
        share = np.minimum(share_low, share_high)
        lever, along = self._levers(segments, candidates)
        height = np.maximum(candidates.top - candidates.tip, 0.0)
        tipping = along / (_FRICTION * width + height)
        weight = _LEVER * lever + np.maximum(tipping - _RESISTED, 0.0)
        score = candidates.score + share - _TWIST * np.minimum(twist, 1.0)
        score -= np.minimum(weight, _LEVER * _LONGEST) + _WEDGE * wedge
        slant = np.hypot(wedge, candidates.lean)
        score = np.where(slant < STEEPEST, score, -np.inf)
        return dc.replace(candidates, score=score)

    def _levers(
        self, segments: Segmentation, candidates: Candidates
    ) -> tuple[Vector, Vector]:
        """Return the distances of each thing's middle from the middle between the pads.

        Returns:
            Distances across the closing direction and along it, shape (n,) each [m].
        """
        between = 0.5 * (candidates.low + candidates.high)
        p_W = candidates.p_W + between[:, None] * candidates.direction
        cells = segments.map.cells(p_W)
        iy = np.clip(cells[:, 0], 0, segments.labels.shape[0] - 1)
        ix = np.clip(cells[:, 1], 0, segments.labels.shape[1] - 1)
        apart = segments.thing_middles[iy, ix] - p_W
        across = np.stack(
            [-candidates.direction[:, 1], candidates.direction[:, 0]], axis=-1
        )
        lever = np.abs(np.sum(apart * across, axis=-1))
        along = np.abs(np.sum(apart * candidates.direction, axis=-1))
        known = np.isfinite(lever)
        lever = np.where(known, np.minimum(lever, _LONGEST), _UNKNOWN)
        return lever, np.where(known, along, 0.0)


def sample(
    segments: Segmentation, p_W: Vector, yaw: Vector, s: Vector, t: Vector
) -> Floats:
    """Return heights below hands, at offsets along the closing and across it.

    Args:
        segments: The segmented map of the table.
        p_W: x, y of the palm's axis in world, shape (n, 2) [m].
        yaw: Direction of closing, shape (n,) [rad].
        s: Offsets along it, shape (S,) [m].
        t: Offsets across it, shape (T,) [m].

    Returns:
        Shape (n, T, S) [m].
    """
    along = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)[:, None, None]
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    points = p_W[:, None, None] + s[:, None] * along
    return segments.lookup(points + t[:, None, None] * across)


class PinchJudge(TopGraspJudge):
    """Judges pinches; for its arguments see `TopGraspJudge`."""

    def __init__(
        self,
        fingers: Fingers,
        *,
        table_gap: float,
        step: float = 0.002,
        across: float = 0.004,
    ) -> None:
        openings = sorted({min(gap, fingers.most_open) for gap in _OPENINGS})
        reach = openings[-1] + _BACKS
        super().__init__(fingers, reach, table_gap=table_gap, step=step, across=across)
        self._deepest = fingers.deepest
        self._silhouettes = [(g, fingers.silhouette(g, self._s)) for g in openings]

    def judge(self, segments: Segmentation, p_W: Vector, yaw: Vector) -> Candidates:
        """Return the best candidate at each place, over all depths and openings."""
        n = len(p_W)
        strip = sample(segments, p_W, yaw, self._s, self._t).max(axis=1)
        middle = np.abs(self._s) < _MIDDLE
        # The thing at the middle, not a taller one beside it.
        around = segments.lookup(p_W)
        near = strip[:, middle].max(axis=1)
        top = np.where(
            around > segments.least, np.minimum(near, around + _TALLER), near
        )
        below_palm = self._below_palm(segments, p_W, yaw)
        # Only `table_gap` keeps the hand off the table.
        obstacle = np.where(strip > segments.least, strip, np.float32(-1.0))
        best = [np.full(n, -np.inf)] + [np.zeros(n) for _ in range(5)]
        for depth in _DEPTHS:
            tip = np.maximum(self._table_gap, top - depth)
            lowest = tip + self._deepest  # of the palm's origin
            fits = below_palm < lowest - self._fingers.palm_x - _CLEARANCE
            between = strip > (tip + _ENGAGED + segments.least / 4)[:, None]
            for opening, silhouette in self._silhouettes:
                gap = (lowest[:, None] - silhouette) - obstacle
                clear = gap.min(axis=1)
                inside = np.abs(self._s) <= opening
                low, high, some = extent(between & inside, self._s)
                lean = np.maximum(
                    lean_of(strip, tip, top, low, 1, self._step, segments.noise),
                    lean_of(strip, tip, top, high, -1, self._step, segments.noise),
                )
                score = _score(tip, top, high - low, lean, clear)
                score = score - opening / _OPENING
                beside = opening - np.maximum(-low, high)
                possible = fits & some & (clear > _CLEARANCE)
                possible &= beside > _CLEARANCE
                possible &= (high - low < self._fingers.max_width) & (lean < STEEPEST)
                score = np.where(possible, score, -np.inf)
                better = score > best[0]
                half_gap = np.full(n, opening)
                values = (score, tip, half_gap, low, high, lean)
                for kept, value in zip(best, values, strict=True):
                    kept[better] = value[better]
        score, tip, half_gap, low, high, lean = best
        return Candidates(p_W, yaw, tip, half_gap, low, high, top, lean, score)

    def _floor(self, segments: Segmentation, candidates: Candidates) -> Vector:
        """Return the heights just above the fingers' ends, shape (n,) [m]."""
        return candidates.tip + _ENGAGED + segments.least / 4


def _score(
    tip: Vector, top: Vector, width: Vector, lean: Vector, clear: Vector
) -> Vector:
    """Return the scores of pinches by the strip below the pads.

    Args:
        tip: Height of the fingers' ends, shape (n,) [m].
        top: Height of the thing, shape (n,) [m].
        width: Width of the thing, shape (n,) [m].
        lean: See `Candidates`.
        clear: Distance of the open hand from things, shape (n,) [m].
    """
    # Hold round things below their middle, others with most of the pads.
    wanted = np.clip(0.65 * top, 0.01, 0.055)
    return np.asarray(
        _DEPTH * np.clip((top - tip) / wanted, 0.0, 1.0)
        + _STEEP * (1.0 - np.minimum(lean / STEEPEST, 1.0))
        + np.minimum(clear, _ROOM) / _ROOM
        - 2.0 * np.clip(width - _WIDE, 0.0, None) / _EXCESS
    )


class WrapJudge(TopGraspJudge):
    """Judges wraps of one hand.

    Args:
        fingers: The hand's.
        wrap: Their wrap.
        table_gap: See `TopGraspJudge` [m].
    """

    def __init__(self, fingers: Fingers, wrap: Wrap, *, table_gap: float) -> None:
        widest = wrap.half_gap + _BESIDE
        super().__init__(fingers, widest, table_gap=table_gap, step=0.002, across=0.009)
        self._wrap = wrap
        # Palm x of the lowest point of closing tips, beside the thing.
        out = np.clip(np.abs(self._s) - wrap.hinge_y, 0.0, None)
        reach = wrap.hinge_x + np.sqrt(np.clip(wrap.radius**2 - out**2, 0.0, None))
        self._reach = np.where(out <= wrap.radius, reach, -np.inf)

    def places(
        self, segments: Segmentation, things: Sequence[Thing]
    ) -> tuple[Vector, Vector]:
        """Return places to judge for wraps of things of suitable width.

        Things that reach over the map's edge are left out: they may be wider than they
        seem.

        Args:
            segments: The segmented map of the table.
            things: Things to wrap.

        Returns:
            x, y of the palm's axis in world, shape (n, 2) [m], and directions of
            closing, shape (n,) [rad].
        """
        least, most = self._wrap.widths
        aside = _BESIDE * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
        last = np.array(segments.labels.shape) - 1
        middles = [
            thing.middle
            for thing in things
            if least < thing.size[1] < most + _BLURRED
            and np.all((thing.cells > 0) & (thing.cells < last))
        ]
        p_W = np.reshape([middle + aside for middle in middles], (-1, 2))
        yaws = np.pi * (np.arange(_YAWS) / _YAWS - 0.5)
        return np.repeat(p_W, _YAWS, axis=0), np.tile(yaws, len(p_W))

    def judge(self, segments: Segmentation, p_W: Vector, yaw: Vector) -> Candidates:
        """Return the candidate near each place, centred on the thing below it."""
        low, high = self._sides(segments, p_W, yaw)[2:4]
        direction = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
        p_W = p_W + (0.5 * (low + high))[:, None] * direction
        strip, top, low, high, some = self._sides(segments, p_W, yaw)
        wrap = self._wrap
        palm_z = top + wrap.face_x + wrap.gap
        tip = palm_z - wrap.deepest
        side = top - _EDGE
        lean = np.maximum(
            lean_of(strip, side, top, low, 1, self._step),
            lean_of(strip, side, top, high, -1, self._step),
        )
        beyond = (self._s < (low - _BLURRED)[:, None]) | (
            self._s > (high + _BLURRED)[:, None]
        )
        # Only `table_gap` keeps the tips off the table.
        obstacle = np.where(strip > segments.least, strip, np.float32(-1.0))
        room = palm_z[:, None] - self._reach - obstacle
        clear = np.where(beyond, room, np.inf).min(axis=1)
        below_palm = self._below_palm(segments, p_W, yaw)
        least, most = wrap.widths
        possible = some & (lean < STEEPEST) & (tip > self._table_gap)
        possible &= (high - low > least) & (high - low < most)
        possible &= np.abs(low + high) < 2.0 * _CENTERED
        possible &= clear > _CLEARANCE
        possible &= below_palm < palm_z - self._fingers.palm_x - _CLEARANCE
        score = np.where(possible, -lean / STEEPEST, -np.inf)
        half_gap = np.full(len(p_W), wrap.half_gap)
        return Candidates(p_W, yaw, tip, half_gap, low, high, top, lean, score)

    def _floor(self, segments: Segmentation, candidates: Candidates) -> Vector:
        """Return the heights above which the sides are judged, shape (n,) [m]."""
        return candidates.top - _EDGE

    def _sides(
        self, segments: Segmentation, p_W: Vector, yaw: Vector
    ) -> tuple[Floats, Vector, Vector, Vector, npt.NDArray[np.bool_]]:
        """Return strips of heights below the hand, their tops, and `extent` there."""
        strip = sample(segments, p_W, yaw, self._s, self._t).max(axis=1)
        top = strip[:, np.abs(self._s) <= self._wrap.hinge_y].max(axis=1)
        high = (strip > (top - _EDGE)[:, None]) & (strip > segments.least)
        high &= np.abs(self._s) <= self._wrap.half_gap
        return strip, top, *extent(high, self._s)
