"""Judges pinches from above by what a height map shows, many at a time."""

from __future__ import annotations

import numpy as np

from drake_srg.planning.grasps.candidates import Candidates, GraspJudgeConfig
from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.grasps.flanks import extent, lean_of
from drake_srg.planning.grasps.relief import Relief
from drake_srg.planning.grasps.top_grasp_judge import STEEPEST, TopGraspJudge, sample
from drake_srg.types import Vector

# More room around the open hand is no better [m]. Wider things are harder to hold [m].
_ROOM, _WIDE = 0.012, 0.1
# Weights of the score's terms (docs/grasps.md): depth, steepness, the excess width that
# costs two points and the half gap that costs one [m].
_DEPTH, _STEEP, _EXCESS, _OPENING = 2.5, 2.0, 0.05, 0.3
# Half the width of the middle of a pinch: what is there is taken. It counts as one
# thing up to this height above the point in the middle [m].
_MIDDLE, _TALLER = 0.011, 0.02
# Samples reach this far beyond the widest opening, for the fingers' backs [m].
_BACKS = 0.04


class PinchJudge(TopGraspJudge):
    """Judges pinches of one hand.

    Args:
        fingers: The hand's.
        config: Thresholds.
    """

    def __init__(self, fingers: Fingers, config: GraspJudgeConfig) -> None:
        openings = sorted({min(gap, fingers.most_open) for gap in config.openings})
        super().__init__(fingers, config, openings[-1] + _BACKS)
        self._deepest = fingers.deepest
        self._silhouettes = [fingers.silhouette(g, self._s) for g in openings]

    def judge(self, relief: Relief, p_W: Vector, yaw: Vector) -> Candidates:
        """See `TopGraspJudge`: the best over depths and openings."""
        config, n = self._config, len(p_W)
        strip = sample(relief, p_W, yaw, self._s, self._t).max(axis=1)
        middle = np.abs(self._s) < _MIDDLE
        # The thing at the middle, not a taller one beside it.
        around = relief.lookup(p_W)
        near = strip[:, middle].max(axis=1)
        top = np.where(around > relief.least, np.minimum(near, around + _TALLER), near)
        below_palm = self._below_palm(relief, p_W, yaw)
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
                    lean_of(strip, tip, top, low, 1, self._config.step, relief.noise),
                    lean_of(strip, tip, top, high, -1, self._config.step, relief.noise),
                )
                score = _score(tip, top, high - low, lean, clear)
                score = score - silhouette.half_gap / _OPENING
                beside = silhouette.half_gap - np.maximum(-low, high)
                possible = fits & some & (clear > config.clearance)
                possible &= beside > config.clearance
                possible &= (high - low < self._fingers.max_width) & (lean < STEEPEST)
                score = np.where(possible, score, -np.inf)
                better = score > best[0]
                half_gap = np.full(n, silhouette.half_gap)
                values = (score, tip, half_gap, low, high, lean)
                for kept, value in zip(best, values, strict=True):
                    kept[better] = value[better]
        score, tip, half_gap, low, high, lean = best
        return Candidates(p_W, yaw, tip, half_gap, low, high, top, lean, score)

    def _floor(self, relief: Relief, candidates: Candidates) -> Vector:
        """See `TopGraspJudge`: just above the fingers' ends."""
        return candidates.tip + self._config.engaged + relief.least / 4


def _score(
    tip: Vector, top: Vector, width: Vector, lean: Vector, clear: Vector
) -> Vector:
    """Return how good pinches are, as far as the strip below the pads tells.

    Args:
        tip: Height of the fingers' ends, shape (n,) [m].
        top: Height of the thing, shape (n,) [m].
        width: Of the thing, shape (n,) [m].
        lean: See `Candidates`.
        clear: Distance of the open hand from things, shape (n,) [m].
    """
    # Below the middle of round things, or with most of the pads.
    wanted = np.clip(0.65 * top, 0.01, 0.055)
    return np.asarray(
        _DEPTH * np.clip((top - tip) / wanted, 0.0, 1.0)
        + _STEEP * (1.0 - np.minimum(lean / STEEPEST, 1.0))
        + np.minimum(clear, _ROOM) / _ROOM
        - 2.0 * np.clip(width - _WIDE, 0.0, None) / _EXCESS
    )
