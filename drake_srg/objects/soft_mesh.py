"""Tetrahedral meshes of boxes, for finite elements."""

import numpy as np
import numpy.typing as npt

from drake_srg.types import Vector

# The faces of a unit cell: corners in order, counterclockwise as seen from outside.
_FACES = np.array(
    [
        [[0, 0, 0], [0, 0, 1], [0, 1, 1], [0, 1, 0]],
        [[1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]],
        [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]],
        [[0, 1, 0], [0, 1, 1], [1, 1, 1], [1, 1, 0]],
        [[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0]],
        [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]],
    ]
)


def box_mesh(
    size: npt.ArrayLike, resolution: float
) -> tuple[Vector, npt.NDArray[np.int64]]:
    """Fill a box around the origin with tetrahedra.

    The box is cut into cells. Each cell is cut into twelve tetrahedra, from its middle
    to the two halves of each face. So every tetrahedron has a vertex inside the box;
    Drake needs that to compute how deeply something penetrates a deformable body.

    Args:
        size: Extents along x, y, z [m].
        resolution: Longest edge of the cells [m].

    Returns:
        Vertices, shape (n, 3) [m], and the indices of the four vertices of each
        tetrahedron, shape (m, 4), ordered so that its volume is positive.
    """
    size = np.asarray(size, dtype=float)
    counts = np.maximum(np.ceil(size / resolution - 1e-9), 1).astype(int)
    corners, cells = (
        np.array(list(np.ndindex(*n.tolist()))) for n in (counts + 1, counts)
    )
    vertices = np.vstack([corners, cells + 0.5]) / counts * size - 0.5 * size
    tetrahedra = []
    for middle, cell in enumerate(cells, len(corners)):
        for face in _FACES + cell:
            # The cut joins two even corners, so that neighbours cut a face alike.
            a, b, c, d = np.roll(face, -(face[0].sum() % 2), axis=0)
            for triangle in ((a, b, c), (a, c, d)):
                numbers = np.ravel_multi_index(np.transpose(triangle), counts + 1)
                tetrahedra.append([middle, *numbers])
    return vertices, np.array(tetrahedra)


def vtk_text(vertices: Vector, tetrahedra: npt.NDArray[np.int64]) -> str:
    """Return a mesh of `box_mesh` as the text of a legacy VTK file."""

    def lines(rows: npt.NDArray[np.generic]) -> str:
        return "\n".join(" ".join(map(repr, row)) for row in rows.tolist())

    n, m = len(vertices), len(tetrahedra)
    return (
        "# vtk DataFile Version 3.0\ntetrahedra\nASCII\nDATASET UNSTRUCTURED_GRID\n"
        f"POINTS {n} double\n{lines(vertices)}\n"
        f"CELLS {m} {5 * m}\n{lines(np.insert(tetrahedra, 0, 4, axis=1))}\n"
        f"CELL_TYPES {m}\n{lines(np.full((m, 1), 10))}\n"  # 10: VTK_TETRA
    )
