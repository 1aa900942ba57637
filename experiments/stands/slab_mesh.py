"""Surface meshes of table tops for contact.

Drake replaces the pressure on each piece of a contact surface by one force at the
piece's middle. The top of a box has two triangles, so a flat thing on it would stand on
few such points and rock. On a grid it stands on many.
"""

import numpy as np
import numpy.typing as npt

from drake_srg.types import Vector


def slab_mesh(
    low: npt.ArrayLike, high: npt.ArrayLike, cell: float
) -> tuple[Vector, npt.NDArray[np.int64]]:
    """Return the surface of a box whose top is a grid.

    Args:
        low: The corner with the least coordinates [m].
        high: The opposite corner [m].
        cell: Longest edge of the grid's squares, each of which is cut in two [m].

    Returns:
        Vertices (n, 3) [m], and indices of the triangles' corners (m, 3), outwards.
    """
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    nx, ny = np.ceil((high - low)[:2] / cell - 1e-9).astype(int)
    x, y = (np.linspace(low[i], high[i], n + 1) for i, n in ((0, nx), (1, ny)))
    top = np.stack([*np.meshgrid(x, y), np.full((ny + 1, nx + 1), high[2])], axis=2)
    number = np.arange((nx + 1) * (ny + 1)).reshape(ny + 1, nx + 1)
    a, b = number[:-1, :-1], number[:-1, 1:]
    c, d = number[1:, 1:], number[1:, :-1]
    squares = np.stack([a, b, c, d], axis=2).reshape(-1, 4)
    # Below the rim, going round counter-clockwise, and its mirror image at the bottom.
    rim = np.concatenate(
        [number[0, :-1], number[:-1, -1], number[-1, :0:-1], number[:0:-1, 0]]
    )
    upper = top.reshape(-1, 3)
    lower = upper[rim] * [1.0, 1.0, 0.0] + [0.0, 0.0, low[2]]
    foot = len(upper) + np.arange(len(rim))
    after, foot_after = np.roll(rim, -1), np.roll(foot, -1)
    walls = np.stack([foot, foot_after, after, rim], axis=1)
    middle = len(upper) + len(rim)
    bottom = np.stack([np.full(len(rim), middle), foot_after, foot], axis=1)
    centre = [*0.5 * (low + high)[:2], low[2]]
    sides = np.concatenate([squares, walls])
    triangles = np.concatenate([sides[:, [0, 1, 2]], sides[:, [0, 2, 3]], bottom])
    return np.vstack([upper, lower, centre]), triangles


def obj_text(vertices: Vector, triangles: npt.NDArray[np.int64]) -> str:
    """Return a mesh as Wavefront text, with micrometres."""
    points = (np.round(vertices, 6) + 0.0).tolist()
    lines = [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in points]
    lines += [f"f {a} {b} {c}" for a, b, c in (triangles + 1).tolist()]
    return "\n".join(lines) + "\n"
