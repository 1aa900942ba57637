"""What the judges of all grasps from above share."""

from __future__ import annotations

import abc
import dataclasses as dc

import numpy as np
import numpy.typing as npt

from drake_srg.planning.grasps.candidates import Candidates, GraspJudgeConfig
from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.grasps.flanks import extent, face_of
from drake_srg.planning.grasps.relief import Relief
from drake_srg.types import Vector

Floats = npt.NDArray[np.float32]

# Tangent of the angle between a face and the pad that presses on it, at most. Friction
# would allow 0.6 and blurred edges look less steep than they are.
STEEPEST = 0.45
# Weights of the score's terms (docs/grasps.md): twist, wedge, lever [1/m].
_TWIST, _WEDGE, _LEVER = 2.0, 2.0, 48.0
# With a friction of 0.6, a lying squeeze bottle of 0.575 kg holds by levers of up to
# 10 mm. Beyond that it swings, however long the lever: longer ones than this cost no
# more, and one that is not known costs as much as `_UNKNOWN` [m].
_LONGEST, _UNKNOWN = 0.05, 0.017
# What sticks out along the closing direction tips the thing between the pads. Their
# friction and pressure resist by N (mu w + h), w apart and h high: a middle so many
# times (mu w + h) away costs nothing, and each further multiple a point; with the
# lever, at most what the longest lever costs. A hammer that is held by its head has 3.9
# and falls, a bowl by its wall 1.1.
_FRICTION, _RESISTED = 0.6, 1.5
# Distance between samples below the palm, at most [m].
_PALM_STEP = 0.007
# Samples reach this far beyond the edges of the pads, for errors of the map [m].
_EDGES = 0.002


class TopGraspJudge(abc.ABC):
    """Judges grasps from above by what a height map shows, many at a time.

    Args:
        fingers: The hand's.
        config: Thresholds.
        reach: How far from the palm's middle the hand reaches along the closing
            direction [m].
    """

    def __init__(
        self, fingers: Fingers, config: GraspJudgeConfig, reach: float
    ) -> None:
        self._fingers, self._config = fingers, config
        count = int(reach / config.step)
        self._s: Vector = config.step * np.arange(-count, count + 1.0)
        half = 0.5 * fingers.pad_width + _EDGES
        self._t = np.linspace(-half, half, 2 * int(np.ceil(half / config.across)) + 1)

    @abc.abstractmethod
    def judge(self, relief: Relief, p_W: Vector, yaw: Vector) -> Candidates:
        """Return the best candidate at each place, or nearby.

        Args:
            relief: What stands on the table.
            p_W: x, y of the palm's axis in world, shape (n, 2) [m].
            yaw: Direction of closing, shape (n,) [rad].
        """

    @abc.abstractmethod
    def _floor(self, relief: Relief, candidates: Candidates) -> Vector:
        """Return from which height above the table pads touch a thing, (n,) [m]."""

    def _below_palm(self, relief: Relief, p_W: Vector, yaw: Vector) -> Vector:
        """Return the greatest height below the palm at each place, shape (n,) [m]."""
        y, z = (
            np.linspace(-0.5 * size, 0.5 * size, int(size / _PALM_STEP) + 2)
            for size in self._fingers.palm_size
        )
        return sample(relief, p_W, yaw, y, z).max(axis=(1, 2))

    def refine(self, relief: Relief, candidates: Candidates) -> Candidates:
        """Return candidates whose scores count how the pads lie on the thing.

        Pads that touch it with a corner, or not opposite to each other, turn it. So
        does its weight if it is held far from its middle.
        """
        if not len(candidates.score):
            return candidates
        heights = sample(relief, candidates.p_W, candidates.yaw, self._s, self._t)
        between = heights > self._floor(relief, candidates)[:, None, None]
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
        lever, along = self._levers(relief, candidates)
        height = np.maximum(candidates.top - candidates.tip, 0.0)
        tipping = along / (_FRICTION * width + height)
        weight = _LEVER * lever + np.maximum(tipping - _RESISTED, 0.0)
        score = candidates.score + share - _TWIST * np.minimum(twist, 1.0)
        score -= np.minimum(weight, _LEVER * _LONGEST) + _WEDGE * wedge
        slant = np.hypot(wedge, candidates.lean)
        score = np.where(slant < STEEPEST, score, -np.inf)
        return dc.replace(candidates, score=score)

    def _levers(self, relief: Relief, candidates: Candidates) -> tuple[Vector, Vector]:
        """Return where each thing's middle is, seen from the middle between the pads.

        Returns:
            Distances across the closing direction and along it, shape (n,) each [m].
        """
        between = 0.5 * (candidates.low + candidates.high)
        p_W = candidates.p_W + between[:, None] * candidates.direction
        cells = relief.map.cells(p_W)
        iy = np.clip(cells[:, 0], 0, relief.labels.shape[0] - 1)
        ix = np.clip(cells[:, 1], 0, relief.labels.shape[1] - 1)
        apart = relief.thing_middles[iy, ix] - p_W
        across = np.stack(
            [-candidates.direction[:, 1], candidates.direction[:, 0]], axis=-1
        )
        lever = np.abs(np.sum(apart * across, axis=-1))
        along = np.abs(np.sum(apart * candidates.direction, axis=-1))
        known = np.isfinite(lever)
        lever = np.where(known, np.minimum(lever, _LONGEST), _UNKNOWN)
        return lever, np.where(known, along, 0.0)


def sample(relief: Relief, p_W: Vector, yaw: Vector, s: Vector, t: Vector) -> Floats:
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
