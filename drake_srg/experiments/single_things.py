"""Things that are cleared one at a time: known kinds, sizes drawn, and new meshes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.household import HOUSEHOLD
from drake_srg.types import Vector

HOUSEHOLD_THINGS, SHAPES, MESHES = "household", "shapes", "meshes"
_MM = 0.001
_SIDES = 32  # of round cross-sections
# As `clear_table` draws it: on any side, as it falls.
_POSE = (
    "tilt: [!Uniform {min: -3.1416, max: 3.1416}, !Uniform {min: -1.5708, max: 1.5708}]"
    ", yaw: !Uniform {min: -3.1416, max: 3.1416}, drop: 0.005"
)
_MATERIAL = "mass: 0.2, friction: 0.6"
# Facets of a tenth of the least radius, or round things roll from facet to facet.
_ROUND = f"{_MATERIAL}, resolution: 0.002"
_SHAPES = (
    f"{_MATERIAL}, shape: !Box {{size: !UniformVector "
    "{min: [0.02, 0.03, 0.04], max: [0.08, 0.1, 0.15]}}",
    f"{_ROUND}, shape: !Cylinder {{radius: !Uniform {{min: 0.02, max: 0.04}}, "
    "length: !Uniform {min: 0.03, max: 0.15}}",
    f"{_ROUND}, shape: !Sphere {{radius: !Uniform {{min: 0.02, max: 0.045}}}}",
)
Triangles = npt.NDArray[np.intp]


def thing(group: str, number: int, folder: Path) -> str:
    """Return an object of a scenario as YAML.

    Args:
        group: `household`, `shapes` or `meshes`.
        number: Chooses a kind in turn.
        folder: Where the meshes are; see `write_meshes`.
    """
    if group == SHAPES:
        own = _SHAPES[number % len(_SHAPES)]
    elif group == HOUSEHOLD_THINGS:
        name = HOUSEHOLD[number % len(HOUSEHOLD)]
        own = f"model: package://drake_srg/sdf/{name}.sdf"
    else:
        mesh = folder / f"{sorted(MESH_KINDS)[number % len(MESH_KINDS)]}.obj"
        own = f"model: {mesh}, scale: {_MM}, {_MATERIAL}"
    return f"{{{own}, {_POSE}}}"


def write_meshes(folder: Path) -> None:
    """Write every kind of mesh as NAME.obj, in millimetres.

    Raises:
        ScenarioError: If a file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, (vertices, triangles) in MESH_KINDS.items():
            lines = [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in vertices]
            lines += [f"f {a} {b} {c}" for a, b, c in triangles + 1]
            (folder / f"{name}.obj").write_text("\n".join(lines) + "\n")
    except OSError as error:
        raise ScenarioError(f"{folder}: cannot be written: {error.strerror}") from None


def prism(
    outline: Sequence[tuple[float, float]], middle: tuple[float, float], height: float
) -> tuple[Vector, Triangles]:
    """Return an upright prism.

    Args:
        outline: Its corners, counterclockwise.
        middle: A point inside from which all of the outline is seen.
        height: Of the prism.
    """
    n = len(outline)
    level = np.array([*outline, middle])
    vertices = np.vstack(
        [np.column_stack([level, np.full(n + 1, z)]) for z in (0.0, height)]
    )
    triangles = []
    for i in range(n):
        j, top = (i + 1) % n, n + 1
        triangles += [(j, i, n), (top + i, top + j, top + n)]
        triangles += [(i, j, top + j), (i, top + j, top + i)]
    return vertices, np.array(triangles)


def tube(
    radius: float, bend: float, angle: float, steps: int
) -> tuple[Vector, Triangles]:
    """Return a round bar, bent along an arc; a ring if the arc is a whole turn.

    Args:
        radius: Of the bar.
        bend: Radius of the arc.
        angle: Of the arc [rad].
        steps: Number of pieces of the arc.
    """
    ring = angle >= 2.0 * np.pi
    around = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    along = angle * np.arange(steps if ring else steps + 1) / steps
    out = bend + radius * np.cos(around)
    vertices = np.concatenate(
        [
            np.column_stack([out * np.cos(a), out * np.sin(a), radius * np.sin(around)])
            for a in along
        ]
    )
    triangles = []
    for k in range(steps):
        this, following = k * _SIDES, (k + 1) % len(along) * _SIDES
        for i in range(_SIDES):
            j = (i + 1) % _SIDES
            triangles += [
                (this + i, following + j, this + j),
                (this + i, following + i, following + j),
            ]
    if not ring:
        last = steps * _SIDES
        for i in range(1, _SIDES - 1):
            triangles += [(0, i, i + 1), (last, last + i + 1, last + i)]
    return vertices, np.array(triangles)


def _star(points: int, outer: float, inner: float) -> list[tuple[float, float]]:
    angles = np.pi * np.arange(2 * points) / points
    radii = np.where(np.arange(2 * points) % 2, inner, outer)
    return [(r * np.cos(a), r * np.sin(a)) for r, a in zip(radii, angles, strict=True)]


def _cross(arm: float, half: float) -> list[tuple[float, float]]:
    quarter = np.array([(half, half), (half, arm), (-half, arm)])
    turns = [np.array([[c, -s], [s, c]]) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    return [(x, y) for turn in turns for x, y in quarter @ turn.T]


# Vertices [mm] and triangles.
MESH_KINDS: dict[str, tuple[Vector, Triangles]] = {
    "angle": prism(
        [(0, 0), (85, 0), (85, 26), (26, 26), (26, 65), (0, 65)], (13, 13), 32
    ),
    "bow": tube(15, 60, 0.5 * np.pi, 12),
    "cross": prism(_cross(48, 14), (0, 0), 24),
    "ring": tube(13, 38, 2.0 * np.pi, 32),
    "star": prism(_star(5, 50, 26), (0, 0), 28),
    "wedge": prism([(0, 0), (90, 0), (0, 50)], (20, 15), 42),
}
