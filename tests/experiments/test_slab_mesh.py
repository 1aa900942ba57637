from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.geometry import ReadObjToTriangleSurfaceMesh

from experiments.stands.slab_mesh import obj_text, slab_mesh

lengths = st.floats(0.05, 0.3)


@given(lengths, lengths, st.floats(0.01, 0.05), st.floats(0.02, 0.1))
def test_a_slab_is_a_closed_box_with_a_gridded_top(width, depth, height, cell):
    low, high = [0.1, -0.2, -height], [0.1 + width, -0.2 + depth, 0.0]
    vertices, triangles = slab_mesh(low, high, cell)
    np.testing.assert_allclose(vertices.min(axis=0), low, atol=1e-12)
    np.testing.assert_allclose(vertices.max(axis=0), high, atol=1e-12)
    edges = [tuple(t[[i, (i + 1) % 3]]) for t in triangles for i in range(3)]
    assert Counter(edges) == Counter((b, a) for a, b in edges)
    p = vertices[triangles]
    volume = np.einsum("ti,ti->", p[:, 0], np.cross(p[:, 1], p[:, 2])) / 6.0
    assert volume == pytest.approx(width * depth * height)
    top = p[(p[:, :, 2] == 0.0).all(axis=1)]
    assert len(top) >= 2
    assert np.ptp(top, axis=1).max() <= cell + 1e-9


def test_drake_reads_the_text(tmp_path):
    vertices, triangles = slab_mesh([0, 0, -0.04], [0.06, 0.04, 0], 0.02)
    path = tmp_path / "slab.obj"
    path.write_text(obj_text(vertices, triangles))
    mesh = ReadObjToTriangleSurfaceMesh(str(path))
    assert mesh.num_triangles() == len(triangles)
    np.testing.assert_allclose(mesh.vertices(), vertices, atol=1e-6)
