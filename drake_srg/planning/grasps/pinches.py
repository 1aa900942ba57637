"""Judges pinches from above by what a height map shows, many at a time."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
import numpy.typing as npt

from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.grasps.flanks import extent, face_of, lean_of
from drake_srg.planning.grasps.relief import Relief
from drake_srg.types import Vector, positive

Floats = npt.NDArray[np.float32]

# Tangent of the angle between a face and the pad that presses on it, at most. Friction
# would allow 0.6 and blurred edges look less steep than they are.
_STEEPEST = 0.45
# More room around the open hand is no better [m]. Wider things are harder to hold [m].
_ROOM, _WIDE = 0.012, 0.1
# Weights of the score's terms (docs/grasps.md): depth, steepness, twist, wedge, lever
# [1/m], the excess width that costs two points and the half gap that costs one [m].
_DEPTH, _STEEP, _TWIST, _WEDGE, _LEVER = 2.5, 2.0, 2.0, 2.0, 16.0
_EXCESS, _OPENING = 0.05, 0.3
# Longer levers cost no more, and one that is not known costs as much as this [m].
_LONGEST, _UNKNOWN = 0.1, 0.05
# Distance between samples below the palm, at most [m].
_PALM_STEP = 0.007
# Half the width of the middle of a pinch: what is there is taken. It counts as one
# thing up to this height above the point in the middle [m].
_MIDDLE, _TALLER = 0.011, 0.02
# Samples reach this far beyond the widest opening, for the fingers' backs, and beyond
# the edges of the pads, for errors of the map [m].
_BACKS, _EDGES = 0.04, 0.002


@dc.dataclass(kw_only=True)
class PinchConfig:
    """How pinches are judged. Lengths in m."""

    # Half gaps of the open fingers' ends that are tried.
    openings: list[float] = dc.field(
        default_factory=lambda: [0.016, 0.027, 0.04, 0.055, 0.07, 0.085],
        metadata=positive(nonempty=True),
    )
    # How far below the top of a thing the fingers' ends may reach; no further than to
    # the table. In noise, less is no flank: 7 mm down the rim of a plate, pinches
    # slip off.
    depths: list[float] = dc.field(
        default_factory=lambda: [0.015, 0.03, 0.045, 0.06, 0.08, 0.095],
        metadata=positive(nonempty=True),
    )
    # Height above the table that the ends of closing fingers keep.
    table_gap: float = dc.field(default=0.002, metadata={"ge": 0.0})
    # Distance that the open hand keeps from everything; one noisy cell counts less.
    clearance: float = dc.field(default=0.004, metadata={"ge": 0.0})
    # What reaches above the fingers' ends by this is between them.
    engaged: float = dc.field(default=0.002, metadata=positive())
    # Distance between samples along the closing direction, and across it.
    step: float = dc.field(default=0.002, metadata=positive())
    across: float = dc.field(default=0.004, metadata=positive())


@dc.dataclass(frozen=True, eq=False)
class Pinches:
    """Pinches, a row each; those that are impossible have the score -inf.

    Attributes:
        p_W: x, y of the palm's axis in world, shape (n, 2) [m].
        yaw: Direction of closing, shape (n,) [rad].
        tip: Height above the table of the lowest point that closing fingers reach,
            shape (n,) [m].
        half_gap: Of the open fingers' ends, shape (n,) [m].
        low: Where the thing begins along the closing direction, shape (n,) [m].
        high: Where it ends, shape (n,) [m].
        top: Height above the table of what is between the fingers, shape (n,) [m].
        lean: How far its flanks lean inwards, as a tangent, shape (n,).
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

    def take(self, index: npt.NDArray[np.intp]) -> Pinches:
        """Return some of the rows."""
        return Pinches(
            **{f.name: getattr(self, f.name)[index] for f in dc.fields(self)}
        )

    def best(self, count: int) -> Pinches:
        """Return at most `count` possible pinches, the best first."""
        order = np.argsort(-self.score, kind="stable")[:count]
        return self.take(order[np.isfinite(self.score[order])])


class PinchJudge:
    """Judges pinches of one hand.

    Args:
        fingers: The hand's.
        config: Thresholds.
    """

    def __init__(self, fingers: Fingers, config: PinchConfig) -> None:
        self._fingers, self._config = fingers, config
        openings = sorted({min(gap, fingers.most_open) for gap in config.openings})
        most = openings[-1] + _BACKS
        count = int(most / config.step)
        self._s: Vector = config.step * np.arange(-count, count + 1.0)
        half = 0.5 * fingers.pad_width + _EDGES
        self._t = np.linspace(-half, half, 2 * int(np.ceil(half / config.across)) + 1)
        self._deepest = fingers.deepest
        self._silhouettes = [fingers.silhouette(g, self._s) for g in openings]

    def judge(self, relief: Relief, p_W: Vector, yaw: Vector) -> Pinches:
        """Return the best pinch at each place, over depths and openings.

        Args:
            relief: What stands on the table.
            p_W: x, y of the palm's axis in world, shape (n, 2) [m].
            yaw: Direction of closing, shape (n,) [rad].
        """
        config, n = self._config, len(p_W)
        strip = _sample(relief, p_W, yaw, self._s, self._t).max(axis=1)
        middle = np.abs(self._s) < _MIDDLE
        # The thing at the middle, not a taller one beside it.
        around = relief.lookup(p_W)
        near = strip[:, middle].max(axis=1)
        top = np.where(around > relief.least, np.minimum(near, around + _TALLER), near)
        y, z = (
            np.linspace(-0.5 * size, 0.5 * size, int(size / _PALM_STEP) + 2)
            for size in self._fingers.palm_size
        )
        below_palm = _sample(relief, p_W, yaw, y, z).max(axis=(1, 2))
        # Only `table_gap` keeps the hand off the table.
        obstacle = np.where(strip > relief.least, strip, np.float32(-1.0))
        best = [np.full(n, -np.inf)] + [np.zeros(n) for _ in range(5)]
        for depth in config.depths:
            tip = np.maximum(config.table_gap, top - depth)
            lowest = tip + self._deepest  # of the palm's origin
            fits = below_palm < lowest - self._fingers.palm_x - config.clearance
            between = strip > (tip + config.engaged + relief.least / 4)[:, None]
            for silhouette in self._silhouettes:
                gap = (lowest[:, None] - silhouette.reach) - obstacle
                clear = gap.min(axis=1)
                inside = np.abs(self._s) <= silhouette.half_gap
                low, high, some = extent(between & inside, self._s)
                lean = np.maximum(
                    lean_of(strip, tip, top, low, 1, self._config.step),
                    lean_of(strip, tip, top, high, -1, self._config.step),
                )
                score = _score(tip, top, high - low, lean, clear)
                score = score - silhouette.half_gap / _OPENING
                beside = silhouette.half_gap - np.maximum(-low, high)
                possible = fits & some & (clear > config.clearance)
                possible &= beside > config.clearance
                possible &= (high - low < self._fingers.max_width) & (lean < _STEEPEST)
                score = np.where(possible, score, -np.inf)
                better = score > best[0]
                half_gap = np.full(n, silhouette.half_gap)
                values = (score, tip, half_gap, low, high, lean)
                for kept, value in zip(best, values, strict=True):
                    kept[better] = value[better]
        score, tip, half_gap, low, high, lean = best
        return Pinches(p_W, yaw, tip, half_gap, low, high, top, lean, score)

    def refine(self, relief: Relief, pinches: Pinches) -> Pinches:
        """Return pinches whose scores count how the pads lie on the thing.

        Pads that touch it with a corner, or not opposite to each other, turn it. So
        does its weight if it is held far from its middle.
        """
        if not len(pinches.score):
            return pinches
        heights = _sample(relief, pinches.p_W, pinches.yaw, self._s, self._t)
        floor = pinches.tip + self._config.engaged + relief.least / 4
        between = heights > floor[:, None, None]
        inside = np.abs(self._s) <= pinches.half_gap[:, None]
        low, high, some = extent(between & inside[:, None], self._s)  # (n, T)
        # Distances of the thing from each pad, shape (n, T).
        missing = np.where(some, 0.0, np.inf)
        share_low, middle_low, slope_low = face_of(
            low - pinches.low[:, None] + missing, self._t
        )
        share_high, middle_high, slope_high = face_of(
            pinches.high[:, None] - high + missing, self._t
        )
        width = np.maximum(pinches.high - pinches.low, 0.01)
        twist = np.abs(middle_high - middle_low) / width
        wedge = 0.5 * np.abs(slope_high + slope_low)
        share = np.minimum(share_low, share_high)
        lever = self._lever(relief, pinches)
        score = pinches.score + share - _TWIST * np.minimum(twist, 1.0)
        score -= _LEVER * lever + _WEDGE * wedge
        slant = np.hypot(wedge, pinches.lean)
        score = np.where(slant < _STEEPEST, score, -np.inf)
        return dc.replace(pinches, score=score)

    def _lever(self, relief: Relief, pinches: Pinches) -> Vector:
        """Return the distance of each thing's middle from the contact line [m]."""
        middles = np.full((int(relief.labels.max()) + 1, 2), np.nan)
        for thing in relief.things:
            middles[thing.label] = thing.middle
        between = 0.5 * (pinches.low + pinches.high)
        p_W = pinches.p_W + between[:, None] * pinches.direction
        cells = relief.map.cells(p_W)
        iy = np.clip(cells[:, 0], 0, relief.labels.shape[0] - 1)
        ix = np.clip(cells[:, 1], 0, relief.labels.shape[1] - 1)
        apart = middles[relief.labels[iy, ix]] - p_W
        across = np.stack([-pinches.direction[:, 1], pinches.direction[:, 0]], axis=-1)
        lever = np.abs(np.sum(apart * across, axis=-1))
        return np.where(np.isfinite(lever), np.minimum(lever, _LONGEST), _UNKNOWN)


def _sample(relief: Relief, p_W: Vector, yaw: Vector, s: Vector, t: Vector) -> Floats:
    """Return heights below hands, at offsets along the closing and across it.

    Args:
        relief: What stands on the table.
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
    return relief.lookup(points + t[:, None, None] * across)


def _score(
    tip: Vector, top: Vector, width: Vector, lean: Vector, clear: Vector
) -> Vector:
    """Return how good pinches are, as far as the strip below the pads tells.

    Args:
        tip: Height of the fingers' ends, shape (n,) [m].
        top: Height of the thing, shape (n,) [m].
        width: Of the thing, shape (n,) [m].
        lean: See `Pinches`.
        clear: Distance of the open hand from things, shape (n,) [m].
    """
    # Below the middle of round things, or with most of the pads.
    wanted = np.clip(0.65 * top, 0.01, 0.055)
    return np.asarray(
        _DEPTH * np.clip((top - tip) / wanted, 0.0, 1.0)
        + _STEEP * (1.0 - np.minimum(lean / _STEEPEST, 1.0))
        + np.minimum(clear, _ROOM) / _ROOM
        - 2.0 * np.clip(width - _WIDE, 0.0, None) / _EXCESS
    )
