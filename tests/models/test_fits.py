"""Holes are nowhere narrower than they say, and pegs fit with their clearance."""

import numpy as np
import pytest
from pydrake.geometry import Box, Role
from pydrake.math import RigidTransform

from models.built_models import build

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
