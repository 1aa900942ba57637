"""Pinches from above of a known solid of any shape, lying on any side."""

from __future__ import annotations

import dataclasses as dc
import functools

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.common.geometry import ConvexPieces
from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.grasps.grasps import PinchGrasp
from drake_srg.planning.grasps.top_grasps import HeightMapGrasps, TopGrasp
from drake_srg.types import HeightMap, Vector

# Number of the best pinches among which the arm's reach decides.
_MOST = 12
# Resolution of the solid's height map, and margin of the map around it [m].
_RESOLUTION, _AROUND = 0.002, 0.06
# Added to the clearance, because inverse kinematics leaves errors [m].
_SPARE = 1e-3
# Costs of a grasp: per point below the best score [rad²], and per distance of the line
# between the pads from the centre of mass, because the solid turns about that line
# [rad²/m].
_COST, _LEVER = 4.0, 200.0


@functools.lru_cache(maxsize=8)
def solid_pinches(
    fingers: Fingers,
    solid: ConvexPieces,
    up_O: tuple[float, float, float],
    clearance: float,
) -> tuple[PinchGrasp, ...]:
    """Return pinches from above of a solid that is on a level surface.

    They are found on its height map, which shows what a camera above would see.

    Args:
        fingers: The hand's.
        solid: The solid.
        up_O: Its direction that points up, a unit vector.
        clearance: Distance that the hand must keep from the table [m].
    """
    R_OS = RotationMatrix.MakeFromOneVector(np.array(up_O), 2)
    solid = solid.rotated(R_OS.inverse().matrix())
    X_SO = RigidTransform([0.0, 0.0, solid.half_extent(np.array([0.0, 0.0, -1.0]))])
    search = HeightMapGrasps(fingers, 0.0, table_gap=clearance + _SPARE)
    found = search.plan(solid_map(solid)).grasps[:_MOST]
    p_SM = X_SO @ solid.center_of_mass
    return tuple(
        _in_object(_pinch(grasp, found[0].score, X_SO, p_SM), R_OS)
        for top in found
        for grasp in (top, top.half_turn())
    )


def _in_object(grasp: PinchGrasp, R_OS: RotationMatrix) -> PinchGrasp:
    """Return a grasp, with its directions in the solid's own frame."""
    assert grasp.across_O is not None
    return dc.replace(grasp, axis_O=R_OS @ grasp.axis_O, across_O=R_OS @ grasp.across_O)


def _pinch(
    top: TopGrasp, best: float, X_SO: RigidTransform, p_SM: Vector
) -> PinchGrasp:
    """Return a grasp of a solid that stands on a surface S.

    Args:
        top: The grasp, in that surface's frame.
        best: Score of the best grasp.
        X_SO: Pose of the solid [m].
        p_SM: Its centre of mass, shape (3,) [m].
    """
    R_SG = top.X_WG.rotation()
    x, y = 1e3 * top.p_WC[:2]
    lever = abs(float((p_SM - top.p_WC) @ R_SG.matrix()[:, 2]))
    # The fingers may be exchanged.
    across = np.rad2deg(top.yaw) % 180.0
    return PinchGrasp(
        name=f"from above at ({x:.0f}, {y:.0f}) mm, across {across:.0f} degrees",
        p_GO=top.X_WG.inverse() @ X_SO.translation(),
        axis_G=R_SG.inverse() @ np.array([0.0, 0.0, 1.0]),
        across_O=R_SG @ np.array([0.0, 1.0, 0.0]),
        closure_open=top.closure_open,
        closure_closed=top.closure_closed,
        fingers_open=top.fingers_open,
        fingers_closed=top.fingers_closed,
        cost=_COST * (best - top.score) + _LEVER * lever,
        fingers=top.fingers,
        width=top.width,
    )


def solid_map(solid: ConvexPieces) -> HeightMap:
    """Return the map of a solid that stands on z = 0, its origin at x = y = 0."""
    corners = solid.corners
    low, high = corners.min(axis=0), corners.max(axis=0)
    origin = low[:2] - _AROUND
    count = np.ceil((high[:2] - low[:2] + 2.0 * _AROUND) / _RESOLUTION).astype(int)
    flat = HeightMap(origin, _RESOLUTION, np.zeros(count[::-1]))
    p = flat.centers()
    top = np.full(flat.height.shape, low[2])
    for normals, offsets in solid.faces:
        # Each half-space is n_z z <= offset - n_x x - n_y y.
        n_z, room = normals[:, 2], offsets - p @ normals[:, :2].T
        upper, lower = n_z > 1e-9, n_z < -1e-9
        above = np.min(room[..., upper] / n_z[upper], axis=-1)
        below = np.max(room[..., lower] / n_z[lower], axis=-1)
        inside = (above >= below) & np.all(room[..., ~(upper | lower)] >= 0, axis=-1)
        top = np.where(inside, np.fmax(top, above), top)
    return dc.replace(flat, height=top - low[2])
