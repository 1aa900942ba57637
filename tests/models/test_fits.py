"""Holes are nowhere narrower than they say, and pegs fit with their clearance."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.geometry import (
    Box,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    Mesh,
    ProximityProperties,
    ReadObjToTriangleSurfaceMesh,
    Role,
    SceneGraph,
)
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from models.built_models import build, path_of

UP = np.array([0.0, 0.0, 1.0])
DEEP, SHALLOW = -0.019, -0.0005  # m
CLEARANCES = (1000, 300, 100, 50)  # um


def walls(name):
    (body,) = build(name).bodies()
    return [(s, X) for _, s, X in build(name).shapes(body, Role.kProximity)]


def distance(point, shape, X_WS):
    """Signed distance of a point from a box or an upright cylinder [m]."""
    p = X_WS.inverse() @ point
    if isinstance(shape, Box):
        out = np.abs(p) - 0.5 * shape.size()
    else:
        half = 0.5 * shape.length()
        out = np.array([np.hypot(*p[:2]) - shape.radius(), abs(p[2]) - half])
    return np.linalg.norm(np.maximum(out, 0.0)) + min(out.max(), 0.0)


def room(shapes, outline, z):
    """Least distance of the points of an outline at a height from some shapes [m]."""
    points = np.column_stack([outline, np.full(len(outline), z)])
    return min(distance(p, s, X) for p in points for s, X in shapes)


def circle(radius):
    angle = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def rounded_square(half, corner):
    return circle(corner) + (half - corner) * np.sign(circle(1.0) + 1e-12)


def keyed(radius, half_key, reach):
    key = np.array([[reach, -half_key], [reach, half_key], [radius, half_key]])
    return np.concatenate([circle(radius), key])


@pytest.mark.parametrize("c", [1e-3, 1e-4, 5e-5])
@pytest.mark.parametrize(
    ("name", "outline"),
    [
        ("hole_25", lambda c: circle(0.0125 - c)),
        ("hole_12", lambda c: circle(0.006 - c)),
        ("hole_square", lambda c: rounded_square(0.011 - c, 0.003 - c)),
        ("hole_keyed", lambda c: keyed(0.010 - c, 0.003 - c, 0.014 - c)),
    ],
)
@pytest.mark.parametrize("rim", ["", "_chamfer"])
def test_a_thinner_outline_has_its_clearance_all_around(name, outline, rim, c):
    assert room(walls(name + rim), outline(c), DEEP) == pytest.approx(c, rel=0.02)


def test_the_wall_of_a_mesh_is_closed_and_touches_its_circle():
    ((_, wall, _),) = [
        shape
        for shape in build("hole_25_mesh").shapes(
            build("hole_25_mesh").bodies()[0], Role.kProximity
        )
        if isinstance(shape[1], Mesh)
    ]
    mesh = ReadObjToTriangleSurfaceMesh(str(path_of(wall)))
    corners = np.array(mesh.vertices())
    triangles = np.array([[t.vertex(i) for i in range(3)] for t in mesh.triangles()])
    edges = np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)]).tolist()
    # Each edge belongs to two triangles, which pass it in opposite directions.
    assert sorted(edges) == sorted([b, a] for a, b in edges)
    assert len({tuple(edge) for edge in edges}) == len(edges)
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    outer = 0.5 * 96 * 0.035**2 * np.sin(2 * np.pi / 96)
    inner = 96 * 0.0125**2 * np.tan(np.pi / 96)
    assert volume == pytest.approx(0.03 * (outer - inner), rel=1e-4)
    normals = np.cross(b - a, c - a)
    inside = np.linalg.norm(a[:, :2] + b[:, :2] + c[:, :2], axis=1) < 3 * 0.02
    upright = inside & (np.abs(normals[:, 2]) < 1e-12)
    units = normals[upright] / np.linalg.norm(normals[upright], axis=1, keepdims=True)
    distances = -np.einsum("ij,ij->i", units, a[upright])
    assert distances == pytest.approx(np.full(192, 0.0125), abs=2e-6)


@pytest.mark.parametrize("name", ["hole_25", "hole_12", "hole_square", "hole_keyed"])
def test_a_chamfer_widens_the_rim_by_half_a_millimetre_half_way_down(name):
    corner = {"hole_25": 0.0125, "hole_12": 0.006}.get(name, 0.010)
    outline = circle(corner)
    if name == "hole_square":
        outline = rounded_square(0.011, 0.003)
    if name == "hole_keyed":
        outline = outline[np.abs(np.arctan2(outline[:, 1], outline[:, 0])) > 0.6]
    assert room(walls(name), outline, SHALLOW) < 1e-5
    wide = room(walls(f"{name}_chamfer"), outline, SHALLOW)
    assert wide == pytest.approx(5e-4 * np.sqrt(0.5), rel=0.02)


@pytest.mark.parametrize("c", CLEARANCES)
@pytest.mark.parametrize("rim", ["", "_chamfer"])
def test_a_cap_has_its_clearance_around_the_pin(rim, c):
    end = walls(f"peg_bushing{rim}_{c:04}")
    upper = [(s, RigidTransform([0.0, 0.0, 0.03]) @ X) for s, X in end]
    found = room(upper, circle(0.010), DEEP + 0.015)
    assert found == pytest.approx(1e-6 * c, rel=0.02)


@pytest.mark.parametrize("c", CLEARANCES)
@pytest.mark.parametrize(
    ("peg", "hole", "seated"),
    [
        ("peg_square", "hole_square", 0.03),
        ("peg_keyed", "hole_keyed", 0.03),
        ("peg_stepped", "hole_12", 0.0305),
    ],
)
def test_a_seated_peg_touches_nothing_but_its_rest(peg, hole, seated, c):
    """Corners of the peg's pieces, in its hole, are outside every wall."""
    blocks = walls(hole)
    for shape, X in walls(f"{peg}_{c:04}"):
        half = (
            0.5 * shape.size()
            if isinstance(shape, Box)
            else np.array([shape.radius(), shape.radius(), 0.5 * shape.length()])
        )
        outline = (
            np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half[:2]
            if isinstance(shape, Box)
            else circle(half[0])
        )
        bottom = X @ [0.0, 0.0, -half[2]] + [0.0, 0.0, seated]
        found = room(blocks, outline + bottom[:2], bottom[2] + 1e-6)
        assert found > -1e-9


def reach(shape, X, direction):
    """Largest distance of a box or a cylinder from the origin in a direction [m]."""
    d = X.rotation().inverse() @ direction
    if isinstance(shape, Box):
        far = 0.5 * np.abs(d) @ shape.size()
    else:
        far = shape.radius() * np.hypot(*d[:2]) + 0.5 * shape.length() * abs(d[2])
    return direction @ X.translation() + far


@pytest.mark.parametrize("c", CLEARANCES)
def test_each_flat_of_a_square_hole_faces_an_edge_of_the_peg_at_the_clearance(c):
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    edges = [
        corner * shape.size()[:2]
        for shape, _ in walls(f"peg_square_{c:04}")
        if isinstance(shape, Box)
        for corner in square
    ]
    gaps = [
        min(distance([*edge, DEEP], shape, X) for edge in edges)
        for shape, X in walls("hole_square")
        if reach(shape, X, UP) > DEEP  # not the floor
    ]
    assert gaps == pytest.approx(np.full(len(gaps), 1e-6 * c), abs=1e-9)


class Pair:
    """A peg that moves relative to its hole."""

    def __init__(self, peg, hole):
        self._scene_graph = SceneGraph()
        self._source = self._scene_graph.RegisterSource("models")
        self._frame = self._scene_graph.RegisterFrame(
            self._source, GeometryFrame("peg")
        )
        for i, (shape, X) in enumerate([*walls(peg), *walls(hole)]):
            instance = GeometryInstance(X, shape, str(i))
            instance.set_proximity_properties(ProximityProperties())
            if i < len(walls(peg)):
                self._scene_graph.RegisterGeometry(self._source, self._frame, instance)
            else:
                self._scene_graph.RegisterAnchoredGeometry(self._source, instance)
        self._context = self._scene_graph.CreateDefaultContext()

    def contacts(self, X_HP):
        """Return the depth of each contact, and the least overlap of the pair [m].

        Two convex shapes can be moved apart along any direction by their overlap in
        it. The directions here are the normals of the faces and of pairs of edges.
        """
        poses = FramePoseVector()
        poses.set_value(self._frame, X_HP)
        port = self._scene_graph.get_source_pose_port(self._source)
        port.FixValue(self._context, poses)
        query = self._scene_graph.get_query_output_port().Eval(self._context)
        found = []
        for pair in query.ComputePointPairPenetration():
            shapes = [
                (query.inspector().GetShape(g), query.GetPoseInWorld(g))
                for g in (pair.id_A, pair.id_B)
            ]
            one, other = (list(X.rotation().matrix().T) for _, X in shapes)
            across = [np.cross(a, b) for a in one for b in other]
            normals = [*one, *other, *(n for n in across if np.linalg.norm(n) > 1e-3)]
            overlaps = [
                reach(*shapes[0], s * n) + reach(*shapes[1], -s * n)
                for n in (n / np.linalg.norm(n) for n in normals)
                for s in (-1.0, 1.0)
            ]
            found.append((pair.depth, min(overlaps)))
        return found


@pytest.fixture(scope="module")
def pair():
    return Pair("peg_square_0050", "hole_square_chamfer")


@settings(max_examples=50)
@given(
    rpy=st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-0.05, 0.05)),
    offset=st.tuples(st.floats(-1e-3, 1e-3), st.floats(-1e-3, 1e-3)),
    height=st.floats(-0.004, 0.002),
)
def test_a_contact_is_as_deep_as_peg_and_hole_overlap(pair, rpy, offset, height):
    """A peg leans at the rim, where contacts with cylinders were 10 times as deep."""
    R = RotationMatrix(RollPitchYaw(rpy))
    tip = np.array([*offset, height])
    X_HP = RigidTransform(R, tip + R @ [0.0, 0.0, 0.05])
    for depth, overlap in pair.contacts(X_HP):
        assert depth < 1.05 * overlap + 1e-7  # a twentieth: box-box prefers faces
