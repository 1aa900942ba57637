"""Tight fits: blocks with a hole or a pin, and the pegs that are no plain cylinder.

The origin of a block is the middle of its rim, or of the top of its pin, z up. That of
a peg is its middle. Walls are boxes tangent to the outline of a hole, which they never
narrow. They have point contact alone, so that a fit of a hundredth of a millimetre
keeps its width: hydroelastic contact at the moduli of rubber and tableware would be
softer than the clearance.

A square peg consists of boxes where its hole guides it. Between a cylinder and a box,
Drake's point contact takes the overlap along the line between their middles
(FCL's portal refinement): 0.06 mm sideways became 0.75 mm along the peg, and the walls
threw the peg back. Between two boxes, depth and normal are right.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

import numpy as np

from .pieces import Inertial, Piece, Primitive, Proximity, Surface
from .sdf import Files, Model
from .shapes import Points, Solid, at_height, disc, prism, rot_y, rot_z

DEPTH, FLOOR = 0.020, 0.010  # of the hole, and of the block below it [m]
HALF = 0.035  # half of the block's width [m]
SIDES = 24  # of a circle
STEP = 2.0 * np.pi / SIDES
CHAMFER = 0.001  # m, at 45 degrees
CLEARANCES = (1.0e-3, 3.0e-4, 1.0e-4, 5.0e-5)  # all around [m]
LENGTH = 0.1  # of every peg [m]
DIAMETERS = (0.025, 0.012)
SQUARE, CORNER = 0.022, 0.003  # side, and radius of the corners [m]
PIN = 0.010  # radius of the pin, and of the keyed plug [m]
# Width of the key, and how far its way is from the axis. The key is not as long [m].
KEY, KEYWAY, KEY_REACH = 0.006, 0.014, 0.0135
STEP_LENGTH = 0.0195  # of the stepped shaft's end: its shoulder meets the rim [m]
LEAD = 0.006  # of the keyed plug's end, where it has no key yet [m]
GUIDED = 0.03  # of a peg's end, which a hole guides [m]

# The stiffness is the scenario's, one for pegs and holes: 1e8 N/m in `insert`. There, a
# rim gives way by force / (half of this): 0.4 um at 20 N. A corner is rounded off by as
# much.
#
# A step of 2 ms is longer than an impact of steel, so dissipation is numerical here.
# A peg that leaves a wall by a hair meets no contact for a step: 3 N then drive 56 g
# 0.2 mm into the wall, which throws it back. Contact rebounds at 1 / dissipation at
# most [m/s]. Holes and pegs average theirs to 50 s/m, twice the speed at which a peg
# goes in (10 mm/s). At 10 s/m, walls throw a peg back twice as hard. At 200 s/m, a peg
# stays in the wall for so long that it goes in deeper than with half the step.
CONTACT = Proximity(rigid=None, friction=0.35, dissipation=90.0)
# Pads press on a peg as on any object: peg and pad keep the usual dissipation.
PEG = dc.replace(CONTACT, rigid=False, dissipation=10.0, modulus=1e7, resolution=0.004)
BORE = dc.replace(CONTACT, dissipation=PEG.dissipation)  # meets a pin
# Of the hole that is a mesh, for comparison: it meets a peg of 1e11 Pa or more.
MESH = Proximity(rigid=True, friction=CONTACT.friction, dissipation=CONTACT.dissipation)
FACETS = 96
MASS = 0.1  # of a peg [kg]
LOOKS = {
    "top": (0.62, 0.64, 0.66),
    "hole": (0.2, 0.2, 0.22),
    "peg": (0.8, 0.1, 0.08),
}
# A circle between the flats has this much more room towards the corners [m/m].
_ROOM = 1.0 / np.cos(0.5 * STEP) - 1.0


@dc.dataclass(frozen=True)
class Flat:
    """A wall of a hole that touches its outline.

    Attributes:
        name: Name of its pieces.
        angle: Direction in which the wall lies, from x [rad].
        distance: Distance of its face from the axis [m].
        aside: From the foot of the perpendicular to the middle of the face [m].
        width: Width of the face [m].
        thick: From the face outwards [m].
    """

    name: str
    angle: float
    distance: float
    aside: float = 0.0
    width: float = 2.0 * HALF * np.tan(0.5 * STEP)
    thick: float = 0.0  # 0: up to HALF from the axis

    def box(self, name: str, z0: float, z1: float, shift: float = 0.0) -> Piece:
        """Return the wall from z0 to z1, its face moved outwards."""
        near = self.distance + shift
        far = self.distance + self.thick if self.thick else HALF
        size = (far - near, self.width, z1 - z0)
        return _placed(
            f"{name}_{self.name}",
            size,
            (0.5 * (near + far), self.aside, 0.5 * (z0 + z1)),
            0.0,
            self.angle,
        )

    def bevel(self, z: float, up: float) -> Piece:
        """Return the chamfer between the face and the end of the wall at height z.

        Args:
            z: Height [m].
            up: 1 if that is the wall's upper end, -1 if it is the lower.
        """
        half, thick = 0.5 * CHAMFER, CHAMFER
        away = np.sqrt(0.5) * 0.5 * thick  # from the bevel's face to the middle
        size = (thick, self.width, np.sqrt(2.0) * CHAMFER)
        middle = (self.distance + half + away, self.aside, z - up * (half + away))
        return _placed(
            f"bevel_{self.name}", size, middle, up * 0.25 * np.pi, self.angle
        )

    def wall(self, z0: float, z1: float, chamfer: float = 0.0) -> list[Piece]:
        """Return the pieces of the wall, chamfered above (1), below (-1) or not (0)."""
        if not chamfer:
            return [self.box("wall", z0, z1)]
        low, high = (z0, z1 - CHAMFER) if chamfer > 0 else (z0 + CHAMFER, z1)
        edge = (high, z1) if chamfer > 0 else (z0, low)
        return [
            self.box("wall", low, high),
            self.box("edge", *edge, shift=CHAMFER),
            self.bevel(z1 if chamfer > 0 else z0, chamfer),
        ]


def _placed(
    name: str, size: Sequence[float], middle: Points, pitch: float, yaw: float
) -> Piece:
    """Return a box, moved in x, y, z, turned about its middle by pitch, then by yaw."""
    half = 0.5 * np.asarray(size)
    outline = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half[:2]
    seen = prism(outline, -half[2], half[2])
    seen = seen.moved(rot_y(pitch), middle).moved(rot_z(yaw))
    center = rot_z(yaw) @ np.asarray(middle)
    box = Primitive("box", tuple(size), tuple(center), (0.0, pitch, yaw))
    return Piece(name, "top", seen, box, CONTACT)


def _circle(radius: float, **flat: float) -> list[Flat]:
    """Return the walls around a circle."""
    return [Flat(str(i), (i + 0.5) * STEP, radius, **flat) for i in range(SIDES)]


def _rounded_square() -> list[Flat]:
    """Return the walls around a square with rounded corners."""
    straight = 0.5 * SQUARE - CORNER
    flats = []
    for i in range(4):
        side = 0.5 * i * np.pi
        flats.append(Flat(f"side_{i}", side, 0.5 * SQUARE, width=2.0 * HALF))
        for j in range(1, SIDES // 4):
            turn = j * STEP
            along = straight * (np.cos(turn) + np.sin(turn)) + CORNER
            aside = straight * (np.cos(turn) - np.sin(turn))
            flats.append(Flat(f"corner_{i}_{j}", side + turn, along, aside))
    return flats


def _keyhole(chamfer: bool) -> list[Flat]:
    """Return the walls around a circle with a keyway in the direction of x."""
    free = [f for f in _circle(PIN, width=0.004) if abs(_wrapped(f.angle)) > 0.45]
    reach = PIN + (CHAMFER if chamfer else 0.0)
    start = np.sqrt(reach**2 - 0.25 * KEY**2)  # where the keyway leaves the circle
    width, middle = HALF - start, 0.5 * (HALF + start)
    sides = [
        Flat("left", 0.5 * np.pi, 0.5 * KEY, -middle, width),
        Flat("right", -0.5 * np.pi, 0.5 * KEY, middle, width),
    ]
    return [*free, *sides, Flat("end", 0.0, KEYWAY, width=2.0 * KEY)]


def _wrapped(angle: float) -> float:
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


def _block(
    name: str, what: str, flats: Sequence[Flat], reach: float, error: float
) -> Files:
    """Return the files of a block with a hole, and of one that is chamfered.

    Args:
        name: Name of the model.
        what: The hole in words.
        flats: Its walls.
        reach: Half of the floor's width [m].
        error: Room beyond the true outline, in the corners between the walls [m].
    """
    files: Files = {}
    for chamfer in (0, 1):
        rim = f", with a chamfer of {1e3 * CHAMFER:.0f} mm" if chamfer else ""
        walls = _keyhole(chamfer=True) if chamfer and "keyed" in name else flats
        text = (
            f"A block with {what}, {1e3 * DEPTH:.0f} mm deep{rim};\nthe origin is the "
            f"middle of its rim. {len(flats)} flats touch the outline. The corners\n"
            f"between them are up to {1e6 * error:.0f} um farther out. A peg that is "
            "thinner by a clearance c all\n"
            f"around has at most {1.0 + _ROOM:.4f} c to move."
        )
        full = name + ("_chamfer" if chamfer else "")
        model = Model(full, LOOKS, text)
        pieces = [p for f in walls for p in f.wall(-DEPTH - FLOOR, 0.0, chamfer)]
        model.AddLink("block", [*pieces, _floor(reach, CONTACT)], None)
        files |= model.finish(f"sdf/{full}.sdf")
    return files


def _floor(reach: float, contact: Proximity) -> Piece:
    """Return the floor of a hole, of half a width."""
    low, size = -DEPTH - FLOOR, (2 * reach, 2 * reach, FLOOR)
    shape = Primitive("box", size, (0.0, 0.0, low + 0.5 * FLOOR))
    seen = prism(disc(reach + 0.001), low, -DEPTH)
    return Piece("floor", "hole", seen, shape, contact)


def _ring(outlines: Sequence[Points], z0: float, z1: float) -> Solid:
    """Return the solid between two outlines of as many corners, the inner one first."""
    n = len(outlines[0])
    corners = [at_height(outline, z) for outline in outlines for z in (z0, z1)]
    faces = []
    for i in range(n):
        in0, in1, out0, out1 = (i + n * k for k in range(4))
        next_in0, next_in1, next_out0, next_out1 = (
            (i + 1) % n + n * k for k in range(4)
        )
        faces += [
            (in0, in1, next_in1, next_in0),
            (out0, next_out0, next_out1, out1),
            (in1, out1, next_out1, next_in1),
            (in0, next_in0, next_out0, out0),
        ]
    return Solid(np.concatenate(corners), tuple(faces))


def _mesh_hole(radius: float) -> Files:
    """Return the files of a round hole whose wall is one rigid mesh."""
    text = (
        f"As hole_{2e3 * radius:.0f}.sdf, but its wall is a mesh of {FACETS} flats for "
        "hydroelastic contact,\nagainst which point contact is checked."
    )
    model = Model(f"hole_{2e3 * radius:.0f}_mesh", LOOKS, text)
    inner = disc(radius / np.cos(np.pi / FACETS), count=FACETS)
    wall = _ring([inner, disc(HALF, count=FACETS)], -DEPTH - FLOOR, 0.0)
    pieces = [Piece("wall", "top", wall, Surface(wall), MESH), _floor(radius, MESH)]
    model.AddLink("block", pieces, None)
    return model.finish(f"sdf/hole_{2e3 * radius:.0f}_mesh.sdf")


def _pin() -> Files:
    text = (
        f"A pin of {2e3 * PIN:.0f} mm, {1e3 * DEPTH:.0f} mm high, on a block; the "
        "origin is the middle of its top."
    )
    model = Model("pin_20", LOOKS, text)
    low = -DEPTH - FLOOR
    base = Primitive("box", (2 * HALF, 2 * HALF, FLOOR), (0, 0, -DEPTH - 0.5 * FLOOR))
    square = HALF * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    pieces = [
        Piece("base", "hole", prism(square, low, -DEPTH), base, CONTACT),
        _rod("pin", "top", PIN, -DEPTH, 0.0, CONTACT),
    ]
    model.AddLink("block", pieces, None)
    return model.finish("sdf/pin_20.sdf")


def _rod(
    name: str, look: str, radius: float, z0: float, z1: float, contact: Proximity
) -> Piece:
    """Return a cylinder about z: exact in contact."""
    shape = Primitive("cylinder", (radius, z1 - z0), (0.0, 0.0, 0.5 * (z0 + z1)))
    return Piece(name, look, prism(disc(radius, count=48), z0, z1), shape, contact)


def _bar(name: str, low: Points, high: Points) -> Piece:
    """Return a box of a peg."""
    a, b = np.array(low), np.array(high)
    shape = Primitive("box", tuple(b - a), tuple(0.5 * (a + b)))
    outline = np.array([a[:2], [b[0], a[1]], b[:2], [a[0], b[1]]])
    return Piece(name, "peg", prism(outline, a[2], b[2]), shape, PEG)


def _peg(name: str, what: str, c: float, pieces: Sequence[Piece], box: Points) -> Files:
    """Return the files of a peg; its mass is spread over a box of the same size."""
    full = f"peg_{name}_{1e6 * c:04.0f}"
    text = f"{what},\nthinner than its hole by {1e3 * c:g} mm all around."
    model = Model(full, LOOKS, text)
    x, y, z = np.asarray(box) ** 2
    inertia = MASS / 12.0 * np.diag([y + z, x + z, x + y])
    model.AddLink("peg", pieces, Inertial(MASS, (0.0, 0.0, 0.0), inertia))
    return model.finish(f"sdf/{full}.sdf")


def _pegs(c: float) -> Files:
    """Return the files of the pegs with a clearance [m]."""
    end, top = -0.5 * LENGTH, 0.5 * LENGTH
    guided = end + GUIDED
    a, r = 0.5 * SQUARE - c, CORNER - c
    corners = []
    for i, (x, y) in enumerate([(1, 1), (-1, 1), (-1, -1), (1, -1)]):
        rod = _rod(f"corner_{i}", "peg", r, guided, top, PEG)
        at = np.array([x, y, 0.0]) * (a - r)
        assert isinstance(rod.collision, Primitive)
        seen = prism(disc(r, count=48), end, top).moved(p=at)
        shape = dc.replace(rod.collision, xyz=(*at[:2], rod.collision.xyz[2]))
        corners.append(dc.replace(rod, solid=seen, collision=shape))
    cross = [
        _bar("along_x", (-a, r - a, end), (a, a - r, top)),
        _bar("along_y", (r - a, -a, end), (a - r, a, top)),
    ]
    # Their edges lie on the round corners, where these face the flats of the hole.
    for j in range(1, SIDES // 4):
        x, y = a - r + r * np.array([np.cos(j * STEP), np.sin(j * STEP)])
        edges = _bar(f"edges_{j}", (-x, -y, end), (x, y, guided))
        cross.append(dc.replace(edges, look=None))
    files = _peg(
        "square",
        f"A square peg of {1e3 * SQUARE:.0f} mm with round corners of "
        f"{1e3 * CORNER:.0f} mm",
        c,
        [*cross, *corners],
        (2 * a, 2 * a, LENGTH),
    )
    thick, thin = 0.5 * DIAMETERS[0], 0.5 * DIAMETERS[1] - c
    files |= _peg(
        "stepped",
        f"A shaft of {2e3 * thick:.0f} mm with an end of {1e3 * DIAMETERS[1]:.0f} mm "
        f"for hole_12, {1e3 * STEP_LENGTH:.1f} mm long",
        c,
        [
            _rod("end", "peg", thin, end, end + STEP_LENGTH, PEG),
            _rod("shaft", "peg", thick, end + STEP_LENGTH, top, PEG),
        ],
        (1.8 * thick, 1.8 * thick, LENGTH),
    )
    head, plug = 0.012, PIN - c
    files |= _peg(
        "keyed",
        f"A plug of {2e3 * PIN:.0f} mm with a key towards x that begins "
        f"{1e3 * LEAD:.0f} mm above its end, and a square head",
        c,
        [
            _bar("head", (-head, -head, guided), (head, head, top)),
            _rod("plug", "peg", plug, end, guided, PEG),
            _bar(
                "key",
                (0.0, c - 0.5 * KEY, end + LEAD),
                (KEY_REACH, 0.5 * KEY - c, end + DEPTH),
            ),
        ],
        (2 * head, 2 * head, LENGTH),
    )
    outer, bore = 0.015, DEPTH + 0.001
    for chamfer in (0, -1):
        width = 2.0 * outer * np.tan(0.5 * STEP)
        ring = _circle(PIN + c, width=width, thick=outer - PIN - c)
        walls = [
            dc.replace(piece, look="peg", proximity=BORE)
            for flat in ring
            for piece in flat.wall(end, end + bore, chamfer)
        ]
        name = "bushing_chamfer" if chamfer else "bushing"
        files |= _peg(
            name,
            f"A cap with a bore of {2e3 * PIN:.0f} mm for pin_20, of {SIDES} flats "
            f"that touch its circle.\nThe corners between them are "
            f"{1e6 * PIN * _ROOM:.0f} um farther out. It is",
            c,
            [*walls, _rod("cap", "peg", outer, end + bore, top, PEG)],
            (1.8 * outer, 1.8 * outer, LENGTH),
        )
    return files


def build() -> Files:
    """Return the files of the holes, of the pin, of pegs, and of a plain block."""
    blank = Model("hole_none", LOOKS, "A block without a hole; see hole_25.sdf.")
    square = HALF * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    low = -DEPTH - FLOOR
    solid = prism(square, low, 0.0)
    box = Primitive("box", (2 * HALF, 2 * HALF, -low), (0.0, 0.0, 0.5 * low))
    blank.AddLink("block", [Piece("top", "top", solid, box, CONTACT)], None)
    files = blank.finish("sdf/hole_none.sdf") | _pin()
    for diameter in DIAMETERS:
        r, size = 0.5 * diameter, f"{1e3 * diameter:.0f}"
        hole = f"a hole of {size} mm"
        files |= _block(f"hole_{size}", hole, _circle(r), r, r * _ROOM)
    files |= _mesh_hole(0.5 * DIAMETERS[0])
    what = (
        f"a square hole of {1e3 * SQUARE:.0f} mm, corners {1e3 * CORNER:.0f} mm round"
    )
    room = CORNER * _ROOM
    files |= _block("hole_square", what, _rounded_square(), 0.5 * SQUARE, room)
    what = f"a hole of {2e3 * PIN:.0f} mm and a keyway of {1e3 * KEY:.0f} mm"
    files |= _block("hole_keyed", what, _keyhole(False), KEYWAY, PIN * _ROOM)
    for c in CLEARANCES:
        files |= _pegs(c)
    return files
