"""RRT-Connect (Kuffner and LaValle, ICRA 2000) and shortcuts, in any free space."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.random import Generator

from drake_srg.types import Vector

EdgeTest = Callable[[Vector, Vector], bool]


class _Tree:
    """Vertices and their parents; `weights` (N,) of the joints make the metric."""

    def __init__(self, root: Vector, weights: Vector) -> None:
        self.vertices = [root]
        self._weighted = [weights * root]
        self._parents = [-1]
        self._weights = weights

    def extend(self, target: Vector, step: float, is_edge_free: EdgeTest) -> bool:
        """Grow one step towards `target`; return whether nothing is in the way."""
        offsets = np.array(self._weighted) - self._weights * target
        distances = np.linalg.norm(offsets, axis=1)
        nearest = int(np.argmin(distances))
        q_near = self.vertices[nearest]
        share = min(1.0, step / max(distances[nearest], 1e-12))
        q_new = target if share == 1.0 else q_near + share * (target - q_near)
        if not is_edge_free(q_near, q_new):
            return False
        self.vertices.append(q_new)
        self._weighted.append(self._weights * q_new)
        self._parents.append(nearest)
        return True

    def branch(self) -> list[Vector]:
        """Return the vertices from the newest down to the root."""
        branch, index = [], len(self.vertices) - 1
        while index >= 0:
            branch.append(self.vertices[index])
            index = self._parents[index]
        return branch


def rrt_connect(
    q_start: Vector,
    q_goal: Vector,
    *,
    lower: Vector,
    upper: Vector,
    weights: Vector,
    is_edge_free: EdgeTest,
    step: float,
    max_iterations: int,
    rng: Generator,
) -> Vector | None:
    """Search for a free polyline from `q_start` to `q_goal`, both free themselves.

    Two of three samples come from the box that start and goal span, widened by 1 rad,
    because the way around an obstacle is mostly near. The third comes from anywhere
    within the limits.

    Args:
        q_start: First waypoint, shape (N,).
        q_goal: Last waypoint, shape (N,).
        lower: Lower limits, shape (N,).
        upper: Upper limits, shape (N,).
        weights: Weights of the coordinates in the metric, shape (N,).
        is_edge_free: Tells whether a straight line is free.
        step: Longest edge of a tree, in the metric.
        max_iterations: How many samples to draw.
        rng: Draws them.

    Returns:
        The waypoints, shape (K, N), or None after `max_iterations` samples.
    """
    near_lower = np.maximum(lower, np.minimum(q_start, q_goal) - 1.0)
    near_upper = np.minimum(upper, np.maximum(q_start, q_goal) + 1.0)
    first, second = _Tree(q_start, weights), _Tree(q_goal, weights)
    for iteration in range(max_iterations):
        sample = (
            rng.uniform(lower, upper)
            if iteration % 3 == 2
            else rng.uniform(near_lower, near_upper)
        )
        if first.extend(sample, step, is_edge_free):
            target = first.vertices[-1]
            while second.extend(target, step, is_edge_free):
                if second.vertices[-1] is target:
                    path = first.branch()[::-1] + second.branch()[1:]
                    return np.array(path if iteration % 2 == 0 else path[::-1])
        first, second = second, first
    return None


def shortcut_path(
    path: Vector, *, is_edge_free: EdgeTest, attempts: int, rng: Generator
) -> Vector:
    """Replace stretches of a free polyline by straight lines where those are free.

    First each vertex is joined to the furthest one that it sees, then `attempts` pairs
    of random points are joined. Start and end stay.

    Returns:
        The shorter waypoints, shape (K', N).
    """
    vertices, index = [path[0]], 0
    while index < len(path) - 1:
        index = next(
            last
            for last in range(len(path) - 1, index, -1)
            if last == index + 1 or is_edge_free(path[index], path[last])
        )
        vertices.append(path[index])
    for _ in range(attempts):
        if len(vertices) == 2:
            break
        a, b = np.sort(rng.uniform(0.0, len(vertices) - 1.0, 2))
        i, j = int(a), int(b)
        if i == j:
            continue
        q_a = vertices[i] + (a - i) * (vertices[i + 1] - vertices[i])
        q_b = vertices[j] + (b - j) * (vertices[j + 1] - vertices[j])
        if is_edge_free(q_a, q_b):
            vertices = [*vertices[: i + 1], q_a, q_b, *vertices[j + 1 :]]
    return np.array(vertices)
