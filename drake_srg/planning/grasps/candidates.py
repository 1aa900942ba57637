"""Candidates for grasps from above, and how they are judged."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
import numpy.typing as npt

from drake_srg.types import Vector, positive


@dc.dataclass(kw_only=True)
class GraspJudgeConfig:
    """How grasps from above are judged. Lengths in m."""

    # Of pinches: half gaps of the open fingers' ends that are tried.
    openings: list[float] = dc.field(
        default_factory=lambda: [0.016, 0.027, 0.04, 0.055, 0.07, 0.085],
        metadata=positive(nonempty=True),
    )
    # Of pinches: how far below the top of a thing the fingers' ends may reach; no
    # further than to the table. In noise, less is no flank: 7 mm down the rim of a
    # plate, pinches slip off.
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
class Candidates:
    """Grasps from above, a row each; what is impossible has the score -inf.

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

    def take(self, index: npt.NDArray[np.intp]) -> Candidates:
        """Return some of the rows."""
        return Candidates(
            **{f.name: getattr(self, f.name)[index] for f in dc.fields(self)}
        )

    def best(self, count: int) -> Candidates:
        """Return at most `count` possible candidates, the best first."""
        order = np.argsort(-self.score, kind="stable")[:count]
        return self.take(order[np.isfinite(self.score[order])])
