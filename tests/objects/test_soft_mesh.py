from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.objects.soft_mesh import box_mesh, vtk_text

lengths = st.floats(0.01, 0.1)


@given(st.tuples(lengths, lengths, lengths), st.floats(0.02, 0.2))
def test_the_tetrahedra_fill_the_box_without_overlap(size, resolution):
    vertices, tetrahedra = box_mesh(size, resolution)
    a, b, c, d = np.moveaxis(vertices[tetrahedra], 1, 0)
    volumes = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0
    assert np.all(volumes > 0.0)
    assert volumes.sum() == pytest.approx(np.prod(size))
    np.testing.assert_allclose(vertices.min(axis=0), -0.5 * np.array(size))
    np.testing.assert_allclose(vertices.max(axis=0), 0.5 * np.array(size))


def test_neighbours_share_their_faces():
    size = np.array([0.04, 0.06, 0.02])
    vertices, tetrahedra = box_mesh(size, 0.02)
    faces = Counter(
        tuple(sorted(np.delete(tetrahedron, i)))
        for tetrahedron in tetrahedra
        for i in range(4)
    )
    for face, count in faces.items():
        sides = vertices[list(face)] / (0.5 * size)
        on_surface = any(np.allclose(sides[:, k], s) for k in range(3) for s in (-1, 1))
        assert count == (1 if on_surface else 2)


def test_every_tetrahedron_has_a_vertex_inside():
    size = np.array([0.03, 0.05, 0.02])
    vertices, tetrahedra = box_mesh(size, 0.02)
    inside = np.all(np.abs(vertices) < 0.499 * size, axis=1)
    assert np.all(inside[tetrahedra].any(axis=1))


def test_the_mesh_is_mirror_symmetric():
    # With even counts of cells, so that an evenly squeezed box does not turn.
    vertices, tetrahedra = box_mesh([0.04, 0.04, 0.04], 0.02)

    def cells(points):
        return {tuple(sorted(map(tuple, points[t].round(9) + 0.0))) for t in tetrahedra}

    for axis in range(3):
        mirrored = vertices.copy()
        mirrored[:, axis] *= -1.0
        assert cells(mirrored) == cells(vertices)


def test_the_file_has_all_vertices_and_tetrahedra():
    vertices, tetrahedra = box_mesh([0.02, 0.02, 0.02], 0.02)
    lines = vtk_text(vertices, tetrahedra).splitlines()
    assert lines[4] == "POINTS 9 double"
    assert [float(x) for x in lines[5].split()] == [-0.01, -0.01, -0.01]
    assert lines[14] == "CELLS 12 60"
    assert [int(x) for x in lines[15].split()] == [4, *tetrahedra[0]]
    assert lines[27:] == ["CELL_TYPES 12", *["10"] * 12]
