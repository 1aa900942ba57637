"""Judges wraps from above: grasps of what is too wide for the pads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from drake_srg.planning.grasps.candidates import Candidates, GraspJudgeConfig
from drake_srg.planning.grasps.fingers import Fingers, Wrap
from drake_srg.planning.grasps.flanks import extent, lean_of
from drake_srg.planning.grasps.relief import Relief, Thing
from drake_srg.planning.grasps.top_grasp_judge import (
    STEEPEST,
    Floats,
    TopGraspJudge,
    sample,
)
from drake_srg.types import Vector

# The tips press on a thing's sides within this of its top [m].
_EDGE = 0.02
# Steep sides look as wide as this on a map, at most [m].
_BLURRED = 0.012
# How far the thing's middle may be from the palm's, along the closing direction [m].
_CENTERED = 0.008
# Wraps are tried this far from the middle of a thing [m], in so many directions.
_BESIDE, _YAWS = 0.03, 36


class WrapJudge(TopGraspJudge):
    """Judges wraps of one hand.

    Args:
        fingers: The hand's.
        wrap: How they wrap around things.
        config: Thresholds.
    """

    def __init__(self, fingers: Fingers, wrap: Wrap, config: GraspJudgeConfig) -> None:
        super().__init__(fingers, config, wrap.half_gap + _BESIDE)
        self._wrap = wrap
        # Palm x of the lowest point of closing tips, beside the thing.
        out = np.clip(np.abs(self._s) - wrap.hinge_y, 0.0, None)
        reach = wrap.hinge_x + np.sqrt(np.clip(wrap.radius**2 - out**2, 0.0, None))
        self._reach = np.where(out <= wrap.radius, reach, -np.inf)

    def places(self, relief: Relief, things: Sequence[Thing]) -> tuple[Vector, Vector]:
        """Return where to judge wraps of things that may be as wide as they take.

        What reaches over the map's edge may be wider than it seems, so it is left out.

        Args:
            relief: What stands on the table.
            things: Those to wrap.

        Returns:
            x, y of the palm's axis in world, shape (n, 2) [m], and directions of
            closing, shape (n,) [rad].
        """
        least, most = self._wrap.widths
        aside = _BESIDE * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
        last = np.array(relief.labels.shape) - 1
        middles = [
            thing.middle
            for thing in things
            if least < thing.size[1] < most + _BLURRED
            and np.all((thing.cells > 0) & (thing.cells < last))
        ]
        p_W = np.reshape([middle + aside for middle in middles], (-1, 2))
        yaws = np.pi * (np.arange(_YAWS) / _YAWS - 0.5)
        return np.repeat(p_W, _YAWS, axis=0), np.tile(yaws, len(p_W))

    def judge(self, relief: Relief, p_W: Vector, yaw: Vector) -> Candidates:
        """See `TopGraspJudge`; each palm is first centred on the thing below it."""
        low, high = self._sides(relief, p_W, yaw)[2:4]
        direction = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
        p_W = p_W + (0.5 * (low + high))[:, None] * direction
        strip, top, low, high, some = self._sides(relief, p_W, yaw)
        config, wrap = self._config, self._wrap
        palm_z = top + wrap.face_x + wrap.gap
        tip = palm_z - wrap.deepest
        side = top - _EDGE
        lean = np.maximum(
            lean_of(strip, side, top, low, 1, config.step),
            lean_of(strip, side, top, high, -1, config.step),
        )
        beyond = (self._s < (low - _BLURRED)[:, None]) | (
            self._s > (high + _BLURRED)[:, None]
        )
        # Only `table_gap` keeps the tips off the table.
        obstacle = np.where(strip > relief.least, strip, np.float32(-1.0))
        room = palm_z[:, None] - self._reach - obstacle
        clear = np.where(beyond, room, np.inf).min(axis=1)
        below_palm = self._below_palm(relief, p_W, yaw)
        least, most = wrap.widths
        possible = some & (lean < STEEPEST) & (tip > config.table_gap)
        possible &= (high - low > least) & (high - low < most)
        possible &= np.abs(low + high) < 2.0 * _CENTERED
        possible &= clear > config.clearance
        possible &= below_palm < palm_z - self._fingers.palm_x - config.clearance
        score = np.where(possible, -lean / STEEPEST, -np.inf)
        half_gap = np.full(len(p_W), wrap.half_gap)
        return Candidates(p_W, yaw, tip, half_gap, low, high, top, lean, score)

    def _floor(self, relief: Relief, candidates: Candidates) -> Vector:
        """See `TopGraspJudge`: the height above which the sides are judged."""
        return candidates.top - _EDGE

    def _sides(
        self, relief: Relief, p_W: Vector, yaw: Vector
    ) -> tuple[Floats, Vector, Vector, Vector, npt.NDArray[np.bool_]]:
        """Return strips of heights below the hand, their tops, and `extent` there."""
        strip = sample(relief, p_W, yaw, self._s, self._t).max(axis=1)
        top = strip[:, np.abs(self._s) <= self._wrap.hinge_y].max(axis=1)
        high = (strip > (top - _EDGE)[:, None]) & (strip > relief.least)
        high &= np.abs(self._s) <= self._wrap.half_gap
        return strip, top, *extent(high, self._s)
