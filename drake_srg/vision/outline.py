"""Outlines of known size in a plane: distance, samples, and where they fit best."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np
import numpy.typing as npt

from drake_srg.types import Box, Cylinder, Vector

Mask = npt.NDArray[np.bool_]

# (points (n, 2), parameters (k,)) -> signed distance (n,), its Jacobian (n, k)
Outline = Callable[[Vector, Vector], tuple[Vector, Vector]]

_SAMPLES = 72


def circle(radius: float) -> Outline:
    """Signed distance to a circle [m]; parameters are its centre (x, y)."""

    def outline(points: Vector, parameters: Vector) -> tuple[Vector, Vector]:
        away = points - parameters
        r = np.maximum(np.linalg.norm(away, axis=1), 1e-12)
        return r - radius, -away / r[:, None]

    return outline


def rectangle(width: float, length: float) -> Outline:
    """Signed distance to a rectangle [m]; parameters are centre (x, y) and yaw."""

    def outline(points: Vector, parameters: Vector) -> tuple[Vector, Vector]:
        c, s = np.cos(parameters[2]), np.sin(parameters[2])
        R = np.array([[c, -s], [s, c]])
        local = (points - parameters[:2]) @ R
        beyond = np.abs(local) - 0.5 * np.array([width, length])
        corner = np.maximum(beyond, 0.0)
        outside = np.linalg.norm(corner, axis=1)
        distance = np.where(outside > 0, outside, beyond.max(axis=1))
        nearest = (beyond == beyond.max(axis=1, keepdims=True)).astype(float)
        gradient = np.where(
            outside[:, None] > 0, corner / np.maximum(outside, 1e-12)[:, None], nearest
        ) * np.sign(local)
        turn = gradient[:, 0] * local[:, 1] - gradient[:, 1] * local[:, 0]
        return distance, np.column_stack([-gradient @ R.T, turn])

    return outline


def fit_outline(
    outline: Outline, points: Vector, inside: Mask, start: Vector, pixel: float
) -> Vector:
    """The outline that best separates points inside from points outside.

    Logistic regression of `inside` on the signed distance d: the sum of
    log(1 + exp(+-d / s)) is minimised by Newton's method while its softness s shrinks
    from the first guess's error to a fraction of a pixel. Its linear tails bear wrong
    labels, and no edge has to be located first.

    Args:
        outline: Signed distance and Jacobian.
        points: Pixels on the plane, shape (n, 2) [m].
        inside: Their labels, shape (n,).
        start: First guess of the parameters, shape (k,).
        pixel: A pixel's size on the plane [m].

    Returns:
        Parameters, shape (k,).
    """
    sign = np.where(inside, 1.0, -1.0)
    parameters = np.array(start, dtype=float)
    for softness in pixel * np.array([4.0, 1.0, 0.3, 0.1, 0.03]):
        for _ in range(12):
            d, J = outline(points, parameters)
            near = np.abs(d) < 8 * softness + 2 * pixel
            J, side = J[near], sign[near]
            wrong = 0.5 * (1 + np.tanh(0.5 * side * d[near] / softness))
            gradient = J.T @ (side * wrong) / softness
            H = (J.T * (wrong * (1 - wrong))) @ J / softness**2
            H += 1e-3 * np.diag(np.diag(H)) + 1e-9 * np.eye(len(H)) / pixel**2
            step = -np.linalg.solve(H, gradient)
            move = float(np.linalg.norm(step[:2]))
            parameters += step * min(1.0, 2 * softness / max(move, 1e-12))
            if move < 1e-3 * pixel:
                break
    return parameters


def guess_rectangle(points: Vector, size: Sequence[float]) -> Vector:
    """First guess (x, y, yaw) of a rectangle from points (n, 2) inside it [m]."""
    scale = 1e4  # OpenCV works in single precision; 0.1 mm units suit it
    middle, sides, degrees = cv2.minAreaRect((points * scale).astype(np.float32))
    yaw = np.deg2rad(degrees)
    if (sides[0] < sides[1]) != (size[0] < size[1]):
        yaw += np.pi / 2
    return np.array([middle[0] / scale, middle[1] / scale, yaw])


def outline_samples(shape: Cylinder | Box, parameters: Vector, grow: float) -> Vector:
    """Samples of the outline moved outwards by `grow` [m], shape (n, 2)."""
    t = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    if isinstance(shape, Cylinder):
        r = max(0.0, shape.radius + grow)
        angle = 2 * np.pi * t
        flat = r * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return np.asarray(parameters[:2] + flat)
    half = np.maximum(0.0, 0.5 * np.array(shape.size[:2]) + grow)
    corners = half * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]])
    sides = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(sides)])
    walk = t * along[-1]
    flat = np.stack([np.interp(walk, along, corners[:, i]) for i in (0, 1)], axis=1)
    c, s = np.cos(parameters[2]), np.sin(parameters[2])
    return np.asarray(parameters[:2] + flat @ np.array([[c, s], [-s, c]]))
