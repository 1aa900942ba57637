"""Samples of grasps of a known solid from all directions, good and bad."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.common.geometry import ConvexPieces
from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.grasps.solid_grasps import solid_map
from drake_srg.planning.grasps.top_grasps import HeightMapGrasps

# Planned grasps from one direction, at most. With all that `HeightMapGrasps` finds, a
# small file would cover only a few directions.
_PER_DIRECTION = 12
# Largest shifts either way along the palm's x, y, z [m]: half of the depth of a pad, a
# quarter of its clearance, and half of its width.
_SHIFT = np.array([0.012, 0.006, 0.012])
_TURN = np.deg2rad(15.0)  # largest turn, about any axis


@dc.dataclass(frozen=True, eq=False, kw_only=True)
class SampledGrasp:
    """A pose of the hand from which the fingers close.

    Attributes:
        X_OG: Pose of the palm in the object's frame [m].
        half_gap: Half the gap between the ends of the open fingers [m].
        width: Expected between the pads [m].
        score: Score of the planned grasp; higher is better.
        shifted: Whether it is a planned grasp that was moved at random.
        wrapped: Whether the planned grasp is a wrap, not a pinch.
    """

    X_OG: RigidTransform
    half_gap: float
    width: float
    score: float
    shifted: bool
    wrapped: bool


def sample_grasps(
    fingers: Fingers, solid: ConvexPieces, seed: int, direction: int
) -> list[SampledGrasp]:
    """Return grasps from one direction, which is drawn uniformly from the sphere.

    They are those that `HeightMapGrasps` plans for the solid as it lies with that
    direction up, with either finger on either side. Each comes a second time, moved and
    turned at random. Many of these fail.

    Args:
        fingers: The hand's.
        solid: The object, in its own frame.
        seed: Seed of random draws.
        direction: Number of the direction; each has random draws of its own.
    """
    rng = np.random.default_rng([seed, direction])
    up_O = rng.normal(size=3)
    R_OS = RotationMatrix.MakeFromOneVector(up_O / np.linalg.norm(up_O), 2)
    turned = solid.rotated(R_OS.inverse().matrix())
    below = turned.half_extent(np.array([0.0, 0.0, -1.0]))
    X_OS = RigidTransform(R_OS.inverse(), [0.0, 0.0, below]).inverse()
    plan = HeightMapGrasps(fingers, 0.0).plan(
        solid_map(turned), seed=int(rng.integers(2**31))
    )
    found = []
    for top in plan.grasps[:_PER_DIRECTION]:
        X_SG = (top.half_turn() if rng.integers(2) else top).X_WG
        grasp = SampledGrasp(
            X_OG=X_OS @ X_SG,
            half_gap=top.half_gap,
            width=top.width,
            score=top.score,
            shifted=False,
            wrapped=top.wrapped,
        )
        found += [grasp, _shifted(grasp, rng)]
    return found


def _shifted(grasp: SampledGrasp, rng: np.random.Generator) -> SampledGrasp:
    axis = rng.normal(size=3)
    turn = AngleAxis(rng.uniform(0.0, _TURN), axis / np.linalg.norm(axis))
    shift = RigidTransform(RotationMatrix(turn), rng.uniform(-_SHIFT, _SHIFT))
    return dc.replace(grasp, X_OG=grasp.X_OG @ shift, shifted=True)
