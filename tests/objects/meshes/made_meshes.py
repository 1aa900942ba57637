"""Meshes in files, without a mesh library."""

import base64
import importlib.util
import json
import struct

import numpy as np
import pytest

# Not imported with the tests: it takes a second, and every worker collects all files.
NEEDS_TRIMESH = pytest.mark.skipif(
    importlib.util.find_spec("trimesh") is None, reason="the extra `import`"
)

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


def cup(size=0.06, wall=0.006):
    """Return a square cup, open above: its outside and rim, then its inside.

    Returns:
        Vertices, faces, and the number of faces of the outside and the rim.
    """
    outer, _ = box([size] * 3)
    inner, _ = box([size - 2 * wall] * 2 + [size - wall], [0, 0, 0.5 * wall])
    shell = [face for face in FACES if not np.all(CORNERS[face][:, 2] > 0)]
    rim = [(1, 5, 13, 9), (5, 7, 15, 13), (7, 3, 11, 15), (3, 1, 9, 11)]
    rim = [t for a, b, c, d in rim for t in ((a, b, c), (a, c, d))]
    outside = np.vstack([shell, rim])
    inside = np.array(shell)[:, ::-1] + 8
    return np.vstack([outer, inner]), np.vstack([outside, inside]), len(outside)


def write_obj(path, mesh, head="", materials=()):
    """Write a mesh; `materials` names those of the faces from some index on."""
    vertices, faces = mesh
    lines = [head, *("v " + " ".join(map(repr, map(float, v))) for v in vertices)]
    starts = {start: f"usemtl {name}" for name, start in materials}
    for i, face in enumerate(faces):
        lines += [starts[i]] if i in starts else []
        lines.append("f " + " ".join(str(k + 1) for k in face))
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


def gltf(mesh, *, node=None, material=None, **more):
    """Return the tree of a glTF file, and the bytes of its buffer."""
    vertices, faces = mesh
    vertices = np.asarray(vertices, "<f4")
    numbers = np.asarray(faces, "<u2")
    content = vertices.tobytes() + numbers.tobytes()
    primitive = {"attributes": {"POSITION": 0}, "indices": 1}
    if material is not None:
        primitive["material"] = 0
        more["materials"] = [material]
    accessors = [
        {"bufferView": 0, "componentType": 5126, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5123, "type": "SCALAR"},
    ]
    accessors[0] |= {"count": len(vertices)}
    accessors[1] |= {"count": numbers.size}
    views = [
        {"buffer": 0, "byteLength": vertices.nbytes},
        {"buffer": 0, "byteOffset": vertices.nbytes, "byteLength": numbers.nbytes},
    ]
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, **(node or {})}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(content)}],
        **more,
    }
    return tree, content


def write_gltf(path, tree, content, uri="part.bin"):
    """Write a glTF file and its buffer; without a URI, the buffer is inside."""
    if uri is None:
        data = base64.b64encode(content).decode()
        tree["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{data}"
    else:
        (path.parent / uri).write_bytes(content)
        tree["buffers"][0]["uri"] = uri
    path.write_text(json.dumps(tree))
    return path


def write_glb(path, tree, content):
    """Write a binary glTF file."""
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    content += b"\0" * (-len(content) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(content), 0x004E4942) + content
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path
