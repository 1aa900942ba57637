"""Convex pieces with few corners that represent meshes, and measures of their fit."""

from __future__ import annotations

import dataclasses as dc
import logging
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.installing import require
from drake_srg.objects.meshes.files import (
    TriangleMesh,
    is_cavity,
    mesh_parts,
    require_trimesh,
)
from drake_srg.types import Vector

# Greatest number of a piece's corners. In contact, hulls reduced to 24 corners take 0.4
# times the time of the full hulls.
MOST_CORNERS = 24
# Largest distance between hulls and the mesh that they replace [m].
TOLERANCE = 0.002
# A corner that stands out by less than this is left out [m].
_FINE = 5e-5
# A part whose mesh is nowhere deeper than this inside its hull counts as convex [m].
_CONVEX = 0.001
# A part whose hull is thinner than this is a sheet without a volume [m].
_THIN = 1e-6
# Numbers of random points on a mesh and on a hull. Each point is compared with the
# triangles of its `_NEAREST` nearest points on the mesh.
_SAMPLES, _HULL_SAMPLES, _NEAREST = 20_000, 500, 16


@dc.dataclass(frozen=True)
class Fit:
    """Quality of convex pieces that represent a mesh.

    Attributes:
        excess: Largest distance of the pieces' surface outside the mesh [m].
        gap: Largest distance of the mesh outside the pieces [m].
    """

    excess: float
    gap: float


def convex_pieces(
    mesh: TriangleMesh, most: int, warnings: list[str]
) -> tuple[list[Vector], bool]:
    """Return the corners of convex pieces that represent a mesh.

    A convex part, such as one cut by another program, stays one piece. CoACD cuts all
    other parts.

    Args:
        mesh: The mesh.
        most: Greatest number of pieces.
        warnings: Receives the parts that are left out or cut although they are convex.

    Returns:
        Corners of each piece, shape (n, 3) [m], and whether CoACD made some.

    Raises:
        ImportError: If CoACD is needed but missing.
    """
    parts = mesh_parts(mesh)
    bodies = [part for part in parts if not _is_flat(part)]
    if not bodies:  # faces without a common corner
        return [decimated(piece) for piece in _cut(mesh, most)], True
    if len(bodies) < len(parts):
        warnings.append(f"flat parts are seen, not touched: {len(parts) - len(bodies)}")
    solid = [part for part in bodies if not is_cavity(part, mesh)]
    convex = [part for part in solid if _is_convex(part)]
    if len(convex) == len(solid) <= most:
        return [decimated(np.asarray(part.vertices)) for part in convex], False
    if len(convex) >= most:
        warnings.append(
            f"CoACD cuts {len(convex)} convex parts into {most} pieces at most "
            f"({len(convex)} pieces would keep them)"
        )
        return [decimated(piece) for piece in _cut(mesh, most)], True
    kept = [np.asarray(part.vertices) for part in convex]
    whole = {id(part) for part in convex}
    rest = [part for part in bodies if id(part) not in whole]
    cut = _cut(require_trimesh().util.concatenate(rest), most - len(kept))
    return [decimated(piece) for piece in (*kept, *cut)], True


def decimated(points: Vector) -> Vector:
    """Return the corners of a simpler hull that replaces the hull of points.

    It starts from the extreme points along 14 directions, and repeatedly adds the point
    that stands out most, until all points stand out by less than 0.05 mm or there are
    `MOST_CORNERS`. If a point still stands out by more than the tolerance, the hull
    grows by half of that distance.

    Args:
        points: Shape (n, 3) [m].
    """
    corners = points[ConvexHull(points).vertices]
    signs = np.array([(1, 1, 1), (1, 1, -1), (1, -1, 1), (1, -1, -1)])
    along = corners @ np.vstack([np.eye(3), signs]).T
    chosen = list(dict.fromkeys([*along.argmax(axis=0), *along.argmin(axis=0)]))
    while True:
        try:
            planes = ConvexHull(corners[chosen]).equations
        except QhullError:  # the first few lie in one plane
            chosen.append(next(k for k in range(len(corners)) if k not in chosen))
            continue
        outside = (corners @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        farthest = int(outside.argmax())
        if len(chosen) >= MOST_CORNERS or outside[farthest] < _FINE:
            break
        chosen.append(farthest)
    kept = corners[sorted(chosen)]
    if outside[farthest] <= TOLERANCE:
        return kept
    away = kept - kept.mean(axis=0)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    return kept + 0.5 * outside[farthest] * away


def measure_fit(mesh: TriangleMesh, pieces: Sequence[Vector]) -> Fit:
    """Measure the distances between a mesh and the hulls of its pieces, both ways.

    Args:
        mesh: The mesh.
        pieces: Corners of each piece, shape (n, 3) [m].
    """
    trimesh = require_trimesh()
    seen, faces = trimesh.sample.sample_surface(mesh, _SAMPLES, seed=0)
    planes = [ConvexHull(corners).equations for corners in pieces]

    def depths(points: Vector) -> Vector:
        """Return distances of points (n, 3) outside each hull, shape (pieces, n)."""
        return np.array([(points @ p[:, :3].T + p[:, 3]).max(axis=1) for p in planes])

    gap = depths(np.vstack([seen, mesh.vertices])).min(axis=0).max()
    touched = []
    for i, corners in enumerate(pieces):
        hull = trimesh.convex.convex_hull(corners)
        samples, _ = trimesh.sample.sample_surface(hull, _HULL_SAMPLES, seed=i)
        touched.append(np.vstack([corners, samples]))
    points = np.vstack(touched)
    owner = np.repeat(np.arange(len(pieces)), [len(p) for p in touched])
    others = depths(points)
    others[owner, np.arange(len(points))] = np.inf
    points = points[others.min(axis=0) > -1e-5]  # inner surfaces have no contact
    if len(mesh.faces) <= _NEAREST:
        candidates = np.tile(np.arange(len(mesh.faces)), (len(points), 1))
    else:
        candidates = faces[cKDTree(seen).query(points, k=_NEAREST)[1]]
    best = np.full(len(points), np.inf)
    outside = np.zeros(len(points), bool)
    for column in candidates.T:
        at = trimesh.triangles.closest_point(mesh.triangles[column], points)
        away = points - at
        distance = np.linalg.norm(away, axis=1)
        closer = distance < best
        best[closer] = distance[closer]
        ahead = np.einsum("ij,ij->i", away, mesh.face_normals[column]) > 0.0
        outside[closer] = ahead[closer]
    return Fit(
        excess=float(np.max(best[outside], initial=0.0)), gap=float(max(gap, 0.0))
    )


def _is_flat(part: TriangleMesh) -> bool:
    """Return whether a mesh lies in one plane, so that it encloses no volume."""
    try:
        hull = ConvexHull(part.vertices)
    except QhullError:
        return True
    return bool(hull.volume < _THIN * hull.area)


def _is_convex(part: TriangleMesh) -> bool:
    """Return whether a connected mesh is nearly its own hull."""
    points = np.vstack([part.vertices, part.triangles_center])
    planes = ConvexHull(part.vertices).equations
    inside = -(points @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    return bool(inside.max() < _CONVEX)


def _cut(mesh: TriangleMesh, most: int) -> list[Vector]:
    """Return the vertices of CoACD's pieces.

    CoACD runs in its own process, because its C++ code cannot be interrupted.
    """
    require("coacd", "import", "Cutting a mesh into convex pieces needs")
    logging.getLogger("drake_srg").warning(
        "cutting a mesh of %d triangles into convex pieces: may take minutes, once",
        len(mesh.faces),
    )
    with tempfile.TemporaryDirectory() as folder:
        there = Path(folder)
        np.savez(there / "mesh.npz", vertices=mesh.vertices, faces=mesh.faces)
        code = _DIE_WITH_PARENT + _COACD
        command = [sys.executable, "-c", code, folder, str(TOLERANCE), str(most)]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, env=environment
        )
        if done.returncode != 0:
            reason = (done.stderr.strip().splitlines() or [str(done.returncode)])[-1]
            raise ScenarioError(f"CoACD cannot cut the mesh: {reason}")
        with np.load(there / "pieces.npz") as pieces:
            return [pieces[key] for key in pieces.files]


# On Linux, this ends the process when a signal kills its parent.
_DIE_WITH_PARENT = """
import ctypes, signal, sys
if sys.platform == "linux":
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
"""
# The threshold is in metres. The search is shallower than CoACD's default, and takes a
# fraction of the time.
_COACD = """
import sys
from pathlib import Path
import coacd
import numpy as np

folder, threshold, most = Path(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3])
coacd.set_log_level("error")
with np.load(folder / "mesh.npz") as file:
    mesh = coacd.Mesh(file["vertices"], file["faces"])
pieces = coacd.run_coacd(
    mesh,
    threshold=threshold,
    real_metric=True,
    max_convex_hull=most,
    mcts_nodes=10,
    mcts_iterations=40,
    mcts_max_depth=2,
    seed=0,
)
np.savez(folder / "pieces.npz", *[np.asarray(vertices) for vertices, _ in pieces])
"""
