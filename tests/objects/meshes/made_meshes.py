"""Meshes in files, without a mesh library."""

import numpy as np

# Corners of a unit cube around the origin, and its faces seen from outside.
CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) - 0.5
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4)]
QUADS += [(1, 5, 7, 3)]
FACES = np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))])


def box(size, at=(0.0, 0.0, 0.0), R=None):
    """Return vertices and faces of a box."""
    R = np.eye(3) if R is None else R
    return (CORNERS * np.asarray(size)) @ R.T + np.asarray(at), FACES


def joined(*parts):
    """Return several meshes as one."""
    vertices, faces, count = [], [], 0
    for v, f in parts:
        vertices.append(v)
        faces.append(np.asarray(f) + count)
        count += len(v)
    return np.vstack(vertices), np.vstack(faces)


def elbow(side=0.03, length=0.09):
    """Return an L-shaped solid in one part: not convex."""
    outline = np.array([(0, 0), (length, 0), (length, side), (side, side)])
    outline = np.vstack([outline, [(side, length), (0, length)]])
    n = len(outline)
    low = np.column_stack([outline, np.zeros(n)])
    high = np.column_stack([outline, np.full(n, side)])
    caps = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
    faces = [(c, b, a) for a, b, c in caps]
    faces += [(a + n, b + n, c + n) for a, b, c in caps]
    for i in range(n):
        j = (i + 1) % n
        faces += [(i, j, j + n), (i, j + n, i + n)]
    return np.vstack([low, high]), np.array(faces)


def write_obj(path, mesh, head=""):
    vertices, faces = mesh
    lines = [head, *("v " + " ".join(map(repr, map(float, v))) for v in vertices)]
    lines += ["f " + " ".join(str(k + 1) for k in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


def write_stl(path, mesh):
    vertices, faces = mesh
    lines = ["solid thing"]
    for face in faces:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex " + " ".join(f"{x:.9g}" for x in vertices[k]) for k in face]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid thing"]) + "\n")
    return path
