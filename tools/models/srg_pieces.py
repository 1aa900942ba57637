"""Geometry of the SRG's links.

Every finger link has x along the link, y inwards (the closing side) and z along its
hinge, so that both fingers share their meshes. Lengths in metres.
"""

from __future__ import annotations

import functools

import numpy as np

from drake_srg.common.srg_geometry import SRG

from .pieces import (
    Piece,
    Primitive,
    Proximity,
    VolumeMesh,
    box_piece,
    extruded_piece,
)
from .shapes import block, disc, hull_2d, prism, revolve, rot_x, rot_y

# What planning and experiments need, too, is in `SRG`, with its sources. These numbers
# are the model's alone, from the bounding boxes of the vendor's STL parts.
BASE_REAR, BASE_WIDTH, BASE_THICKNESS = 0.0096, 0.0300, 0.0220
TIP_WIDTH, TIP_THICKNESS = 0.0169, 0.0223

LOOKS = {
    "shell": (0.27, 0.28, 0.31),
    "servo": (0.12, 0.12, 0.13),
    "metal": (0.62, 0.63, 0.65),
    "rubber": (0.07, 0.07, 0.075),
}

# Nylon on a can or on itself: handbooks give 0.3 to 0.5.
PLASTIC = Proximity(rigid=True, friction=0.4, resolution=0.005)
# Soft rubber: holds and places a can at steps of 1 to 10 ms. It has no resolution hint
# because Drake meshes a compliant box the same way at any resolution.
RUBBER = Proximity(rigid=False, friction=0.8, modulus=2e6, dissipation=5.0)

PLATE_IN, PLATE_OUT = 0.0158, 0.0208  # |z| of the palm's plates, which hold the fingers
NOSE = 0.0086  # radius of the base link's far end; clears the pad by 0.2 mm


plastic_box = functools.partial(box_piece, proximity=PLASTIC)
_extruded = functools.partial(extruded_piece, proximity=PLASTIC)


@functools.cache
def palm_pieces() -> list[Piece]:
    """Return the palm: +x points out of it, the fingers move in the x-y plane."""
    half_y, half_z = SRG.palm_width / 2, SRG.palm_height / 2
    pieces = [
        Piece(
            "palm_mount",
            "metal",
            revolve([(0.0305, 0), (0.0315, 0.001), (0.0315, 0.007), (0.0305, 0.008)])
            .moved(rot_y(np.pi / 2)),
            Primitive("cylinder", (0.0315, 0.008), (0.004, 0, 0), (0, np.pi / 2, 0)),
            PLASTIC,
        ),
        plastic_box(
            "palm_core", "shell",
            (0.008, -0.033, -PLATE_IN), (0.059, 0.033, PLATE_IN), 0.0015,
        ),
        # An object deep between the fingers touches this.
        plastic_box(
            "palm_face", "rubber",
            (0.058, -0.0188, -PLATE_IN), (SRG.palm_face_x, 0.0188, PLATE_IN), 0.0015,
        ),
    ]  # fmt: skip
    plate = np.array(
        [(0.0085, y) for y in (-0.027, 0.027)]
        + [(0.026, y) for y in (-half_y, half_y)]
        + [(0.060, y) for y in (-half_y, half_y)]
        + [(0.066, y) for y in (-0.022, 0.022)]
    )
    for side, s in (("upper", 1), ("lower", -1)):
        z0, z1 = sorted((s * PLATE_IN, s * PLATE_OUT))
        pieces.append(_extruded(f"palm_{side}_plate", "shell", plate, z0, z1, 0.001))
        for hand, h in (("left", 1), ("right", -1)):
            ear = hull_2d(
                disc(SRG.palm_length - SRG.hinge_x, (SRG.hinge_x, h * SRG.hinge_y), 20),
                np.array([(0.058, h * half_y), (0.058, h * 0.0165)]),
            )
            name = f"palm_{side}_{hand}_ear"
            pieces.append(_extruded(name, "shell", ear, z0, z1, 0.001))
            pin = disc(0.0035, (SRG.hinge_x, h * SRG.hinge_y), 16)
            z0_, z1_ = sorted((s * (PLATE_OUT - 0.001), s * (PLATE_OUT + 0.001)))
            pieces.append(Piece(name + "_pin", "metal", prism(pin, z0_, z1_, 0.0004)))
        for x, y in ((0.017, 0.024), (0.017, -0.024), (0.054, 0.034), (0.054, -0.034)):
            z0, z1 = sorted((s * (PLATE_OUT - 0.001), s * (PLATE_OUT + 0.0006)))
            screw = prism(disc(0.0022, (x, y), 12), z0, z1, 0.0003)
            pieces.append(Piece("palm_screw", "metal", screw))
    # The servo's case below has ribs 1 mm high; its collision geometry is one box.
    x0, x1, y0, y1 = 0.0095, 0.0555, -0.0201, 0.0201
    z0, z1 = -half_z, -PLATE_OUT + 0.001
    case = block((x0, y0, z0 + 0.001), (x1, y1, z1), 0.0015)
    box = Primitive(
        "box", (x1 - x0, y1 - y0, z1 - z0), ((x0 + x1) / 2, 0, (z0 + z1) / 2)
    )
    pieces.append(Piece("palm_servo", "servo", case, box, PLASTIC))
    for i in range(7):
        x = x0 + 0.005 + 0.006 * i
        rib = block((x - 0.0011, y0 + 0.002, z0), (x + 0.0011, y1 - 0.002, z1), 0.0006)
        pieces.append(Piece("palm_servo_rib", "servo", rib))
    cover = disc(0.0165, (0.034, 0), 32)
    z0, z1 = PLATE_OUT - 0.001, half_z
    pieces.append(
        Piece(
            "palm_spool_cover",
            "servo",
            prism(cover, z0, z1, 0.0015),
            Primitive(
                "cylinder", (0.0165, z1 - z0), (0.034, 0, (z0 + z1) / 2), (0, 0, 0)
            ),
            PLASTIC,
        )
    )
    return pieces


@functools.cache
def base_pieces() -> list[Piece]:
    """Return a base link: knuckle, body, and two cheeks around the tip's lug."""
    back = SRG.face_offset - BASE_THICKNESS
    half = BASE_WIDTH / 2
    body = hull_2d(
        disc(BASE_REAR, count=24),
        np.array([(0.006, SRG.face_offset), (0.0375, SRG.face_offset)]),
        np.array([(0.018, back), (0.030, back), (0.0375, back + 0.002)]),
    )
    half_rib = 0.008
    rib_back, rib_foot = back - 0.001, back + 0.002
    rib = np.array(
        [(0.013, rib_foot), (0.019, rib_back), (0.031, rib_back), (0.036, rib_foot)]
    )
    side = hull_2d(
        disc(0.0055, count=20),
        np.array([(0.020, -0.009), (0.033, -0.009)]),
        np.array([(0.033, 0.0055), (0.02, 0.0055)]),
    )
    # Stays below the arc that the pad's inner corner sweeps as the tip curls.
    cheek = hull_2d(
        disc(NOSE, (SRG.base_length, 0), 24),
        np.array([(SRG.base_length - 0.0118, 0.0046), (0.0365, 0.0028)]),
        np.array([(0.0365, back + 0.0018), (0.042, back + 0.003)]),
    )
    pieces = [_extruded("base_body", "shell", body, -half, half, 0.0012)]
    pieces += [
        Piece("base_rib", "servo", prism(rib, -half_rib, half_rib, 0.0006)),
        Piece("base_panel", "servo", prism(side, -half - 3e-4, half + 3e-4, 0.0006)),
    ]
    for side, s in (("upper", 1), ("lower", -1)):
        z0, z1 = sorted((s * (TIP_WIDTH / 2 + 0.0005), s * half))
        name = f"base_{side}_cheek"
        pieces.append(_extruded(name, "shell", cheek, z0, z1, 0.001))
        pin = disc(0.003, (SRG.base_length, 0), 16)
        z0, z1 = sorted((s * (half - 0.001), s * (half + 0.0008)))
        pieces.append(Piece(name + "_pin", "metal", prism(pin, z0, z1, 0.0004)))
    return pieces


@functools.cache
def tip_pieces(pad_resolution: float | None = None) -> list[Piece]:
    """Return a tip link: lug and spine, the pad's carrier, the rubber pad.

    With a resolution [m] the pad collides as a mesh of tetrahedra instead of a box.
    """
    far = SRG.pad_end
    near = far - SRG.pad_length
    pad_back = SRG.face_offset - SRG.pad_thickness
    spine_back = SRG.face_offset - TIP_THICKNESS
    spine = hull_2d(
        disc(NOSE, count=24),
        np.array([(0.007, spine_back), (0.016, spine_back), (0.030, pad_back - 0.001)]),
        np.array([(0.030, pad_back + 0.001), (0.012, 0.004)]),
    )
    carrier = np.array(
        [
            (near + 0.001, pad_back - 0.003),
            (0.034, pad_back - 0.003),
            (far - 0.001, pad_back - 0.001),
            (far - 0.001, pad_back + 0.002),
            (near + 0.001, pad_back + 0.002),
        ]
    )
    half = SRG.pad_width / 2
    size = (SRG.pad_length, SRG.pad_thickness, SRG.pad_width)
    middle = ((near + far) / 2, SRG.face_offset - SRG.pad_thickness / 2, 0.0)
    pad: Primitive | VolumeMesh = Primitive("box", size, middle)
    if pad_resolution is not None:
        pad = VolumeMesh(size, middle, pad_resolution)
    # Treads 0.8 mm high across the pad; its collision geometry is the box around them.
    groove = SRG.face_offset - 0.0008
    body = block((near, pad_back, -half), (far, groove, half), 0.0014)
    treads = []
    for x in np.linspace(near + 0.003, far - 0.003, 13):
        profile = [(x - 0.0015, groove - 0.0005), (x + 0.0015, groove - 0.0005)]
        profile += [(x + 0.0009, SRG.face_offset), (x - 0.0009, SRG.face_offset)]
        treads.append(prism(np.array(profile), -half + 0.001, half - 0.001))
    return [
        _extruded("tip_spine", "shell", spine, -TIP_WIDTH / 2, TIP_WIDTH / 2, 0.001),
        _extruded("tip_carrier", "shell", carrier, -half + 0.001, half - 0.001, 0.0008),
        *_screws(),
        Piece("pad", "rubber", body, pad, RUBBER),
        *[Piece("pad_tread", "rubber", ridge) for ridge in treads],
    ]


def _screws() -> list[Piece]:
    """Return the screw heads on the back of the pad's carrier."""
    back = SRG.face_offset - SRG.pad_thickness - 0.0030
    screws = []
    for z in (-0.0115, 0.0115):
        head = prism(disc(0.0017, count=12), -0.0006, 0.0008, 0.0003)
        head = head.moved(rot_x(np.pi / 2), (0.020, back, z))
        screws.append(Piece("tip_screw", "metal", head))
    return screws
