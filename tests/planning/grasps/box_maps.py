"""Height maps of boxes on a table."""

import numpy as np

from drake_srg.types import HeightMap

TABLE = 0.3  # m


def height_map(*boxes, noise=0.0, seed=0, half=0.2):
    """Return a map of boxes (x, y, yaw, length, width, height) on the table [m]."""
    n = round(2 * half / 0.002)
    origin = np.full(2, -half + 0.001)
    found = HeightMap(origin, 0.002, np.full((n, n), TABLE))
    middles = found.centers()
    for x, y, yaw, length, width, height in boxes:
        d = middles - [x, y]
        along = np.cos(yaw) * d[..., 0] + np.sin(yaw) * d[..., 1]
        across = np.cos(yaw) * d[..., 1] - np.sin(yaw) * d[..., 0]
        inside = (np.abs(along) < 0.5 * length) & (np.abs(across) < 0.5 * width)
        found.height[inside] = TABLE + height
    found.height[:] += np.random.default_rng(seed).normal(0.0, noise, (n, n))
    return found


def turn(a, b):
    """Return the angle between two directions without a sense [rad]."""
    return abs((a - b + 0.5 * np.pi) % np.pi - 0.5 * np.pi)
