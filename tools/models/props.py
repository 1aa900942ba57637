"""Props around the robots: tables, floor, tray, belt, marker, lid, bin, can."""

from __future__ import annotations

import numpy as np

from drake_srg.objects.sdf import AddChild

from .pieces import Inertial, Piece, Primitive, Proximity, box_piece
from .sdf import Files, Model
from .shapes import block, disc, prism, revolve, rot_x, union_properties

# Steel on dry wood: handbooks give 0.4 to 0.6.
WOOD = Proximity(rigid=True, friction=0.6)
# A soft foam mat on it, 50 kPa: a hard top gives way to a light object by less than the
# object moves in a step, so it rattles. The mat gives way by 0.1 to 1 mm. What falls
# on it rebounds at 1 / dissipation = 3 mm/s at most. `drake-srg experiment resting`.
MAT = Proximity(rigid=False, friction=0.6, modulus=5e4, dissipation=300.0)
SHEET = Proximity(rigid=True, friction=0.4)

# Of the tray above the table [m].
TRAY_HEIGHT = 0.02

# YCB object set, 005_tomato_soup_can.
CAN_RADIUS, CAN_LENGTH, CAN_MASS = 0.0339, 0.1018, 0.349
# Tinplate around a liquid: 25 times stiffer than the pads, so that the pads yield, but
# soft enough for steps of several milliseconds. The resolution hint gives the circle 22
# sides, at most 0.34 mm inside it. At 0.015 that is 0.7 mm for the same time per step,
# at 0.006 it is 0.1 mm for a quarter more.
CAN = Proximity(
    rigid=False, friction=0.8, modulus=5e7, dissipation=5.0, resolution=0.01
)


def table(
    name: str, top: Proximity, comment: str, meshes: str = "table", half: float = 0.8
) -> Files:
    """Return a table with its top at z = 0; an arm stands on it at the origin.

    Args:
        name: Name of the model.
        top: Material of its top.
        comment: Description of the model.
        meshes: Prefix of the names of its meshes.
        half: Half its width along y [m].
    """
    looks = {"top": (0.74, 0.70, 0.63), "legs": (0.45, 0.46, 0.48)}
    model = Model(name, looks, f"{comment}; its top is z = 0.", meshes=meshes)
    AddChild(model.root, "static", "true")
    low, high = (-0.4, -half, -0.04), (1.3, half, 0)
    pieces = [box_piece("table_top", "top", low, high, 0.0015, top)]
    for x in (-0.34, 1.24):
        for y in (-half + 0.06, half - 0.06):
            leg = f"table_leg_{'rear' if x < 0 else 'front'}_"
            leg += "left" if y > 0 else "right"
            low, high = (x - 0.03, y - 0.03, -0.75), (x + 0.03, y + 0.03, -0.04)
            pieces.append(box_piece(leg, "legs", low, high, 0.0015, WOOD))
    model.AddLink("table", pieces, None)
    model.AddFrame("table_top", "table")
    return model.finish(f"sdf/{name}.sdf")


def floor() -> Files:
    """Return a floor under the table's legs."""
    model = Model("floor", {"floor": (0.55, 0.56, 0.58)}, "A floor, z = -0.75.")
    AddChild(model.root, "static", "true")
    low, high = (-3, -3, -0.85), (3, 3, -0.75)
    model.AddLink("floor", [box_piece("floor", "floor", low, high, 0, WOOD)], None)
    return model.finish("sdf/floor.sdf")


def tray() -> Files:
    """Return a tray on a linear axis along y; its origin is the middle of its top."""
    return _slide("tray", "A tray on a linear axis", (-0.30, 0.62), 0.2, (-0.05, 0.45))


def belt() -> Files:
    """Return a piece of a conveyor's belt, which moves along y as a whole.

    Drake 1.51 has no moving surfaces. The origin is the middle of the top.
    """
    comment = "A piece of a conveyor's belt"
    return _slide("belt", comment, (-0.78, 0.78), 0.6, (-0.55, 0.55))


def _slide(
    name: str,
    comment: str,
    rails: tuple[float, float],
    half: float,
    travel: tuple[float, float],
) -> Files:
    """Return a plate that moves along y, 2 mm above its rails.

    The rails lie TRAY_HEIGHT below the origin.

    Args:
        name: Name of the model.
        comment: Description of the model.
        rails: Their ends along y [m].
        half: Half the plate's length along y [m].
        travel: Limits of the joint [m].
    """
    looks = {name: (0.30, 0.34, 0.40), "rail": (0.62, 0.63, 0.65)}
    model = Model(name, looks, f"{comment}; tools/models/props.py.")
    pieces = [
        box_piece(
            f"rail_{side}",
            "rail",
            (x - 0.01, rails[0], -TRAY_HEIGHT),
            (x + 0.01, rails[1], -TRAY_HEIGHT + 0.008),
            0.0,
            WOOD,
        )
        for side, x in (("near", -0.08), ("far", 0.08))
    ]
    low, high = (-0.15, -half, -TRAY_HEIGHT + 0.01), (0.15, half, 0.0)
    plate = [box_piece("plate", name, low, high, 0.0015, WOOD)]
    # Welded to the world, so the rails' mass [kg] has no effect. The plate is of
    # aluminium honeycomb, 17 kg/m2.
    rail_mass = union_properties([p.solid for p in pieces])
    model.AddLink("rails", pieces, Inertial.uniform(1.0, rail_mass))
    plate_mass = union_properties([p.solid for p in plate])
    model.AddLink("plate", plate, Inertial.uniform(10.0 * half, plate_mass))
    lower, upper = travel
    limits = {"lower": lower, "upper": upper, "effort": 200.0, "velocity": 0.5}
    model.AddJoint(
        "slide", "rails", "plate", [0.0, 1.0, 0.0], limits, 0.0, kind="prismatic"
    )
    model.AddFrame("top", "plate")
    return model.finish(f"sdf/{name}.sdf")


def pedestal() -> Files:
    """Return a column beside the table; its origin is the middle of its top.

    Its top is 17.5 mm above the table's, so that a hand 68.4 mm above the table grasps
    a can on the column at mid height.
    """
    model = Model("pedestal", {"wood": (0.77, 0.65, 0.47)}, "A column on the floor.")
    half, foot, floor_z = 0.055, 0.11, -0.75 - 0.0175
    low, high = (-half, -half, floor_z + 0.03), (half, half, 0)
    pieces = [
        box_piece("column", "wood", low, high, 0.001, WOOD),
        box_piece(
            "foot", "wood", (-foot, -foot, floor_z), (foot, foot, low[2]), 0.001, WOOD
        ),
    ]
    model.AddLink("pedestal", pieces, None)
    model.AddFrame("top", "pedestal")
    return model.finish("sdf/pedestal.sdf")


def marker() -> Files:
    """Return a ring that marks a goal; it has no collision geometry."""
    model = Model("marker", {"ring": (0.15, 0.65, 0.25)}, "Marks a goal, seen only.")
    solids = _ring(0.036, 0.045, 0, 0.001, 48)
    pieces = [Piece("ring", "ring", s) for s in solids]
    model.AddLink("marker", pieces, Inertial.uniform(0.01, union_properties(solids)))
    return model.finish("sdf/marker.sdf")


def _ring(inner: float, outer: float, z0: float, z1: float, count: int) -> list:
    """Return a ring cut into convex wedges."""
    a, b = disc(inner, count=count), disc(outer, count=count)
    wedges = []
    for i in range(count):
        j = (i + 1) % count
        wedges.append(prism(np.array([a[i], b[i], b[j], a[j]]), z0, z1))
    return wedges


def lid() -> Files:
    """Return an upside-down bucket; the origin is the middle of its open rim."""
    model = Model("lid", {"sheet": (0.52, 0.53, 0.55)}, "Hides an object from cameras.")
    inner, wall, height = 0.06, 0.003, 0.14
    count = 24
    # Corners lie outside so that the flats touch the inner radius.
    stretch = 1 / np.cos(np.pi / count)
    solids = _ring(inner * stretch, (inner + wall) * stretch, 0, height, count)
    pieces = []
    middle = inner + wall / 2
    size = (wall, 2 * (inner + wall) * np.tan(np.pi / count), height)
    for i, solid in enumerate(solids):
        angle = 2 * np.pi * (i + 0.5) / count
        x, y = middle * np.cos(angle), middle * np.sin(angle)
        box = Primitive("box", size, (x, y, height / 2), (0, 0, angle))
        pieces.append(Piece(f"lid_wall_{i}", "sheet", solid, box, SHEET))
    roof = prism(disc((inner + wall) * stretch, count=count), height - wall, height)
    pieces.append(Piece("lid_roof", "sheet", roof, roof, SHEET))
    inertial = Inertial.uniform(0.3, union_properties([*solids, roof]))
    model.AddLink("lid", pieces, inertial)
    return model.finish("sdf/lid.sdf")


def cradle() -> Files:
    """Return four posts that carry a cylinder of 40 to 90 mm diameter along x.

    The two pairs, 0.12 m apart, leave room for a hand to reach around the cylinder from
    above and from below. The origin is in the middle, on the table.
    """
    model = Model("cradle", {"posts": (0.45, 0.46, 0.48)}, "Holds a cylinder up.")
    pieces = []
    for x, end in ((-0.06, "rear"), (0.06, "front")):
        for y, side in ((-0.03, "right"), (0.03, "left")):
            low, high = (x - 0.01, y - 0.01, 0), (x + 0.01, y + 0.01, 0.15)
            pieces.append(
                box_piece(f"post_{end}_{side}", "posts", low, high, 0.001, WOOD)
            )
    model.AddLink("cradle", pieces, None)
    return model.finish("sdf/cradle.sdf")


def bin_() -> Files:
    """Return an open box lined with foam; its origin is underneath its middle.

    A stacking container of 600 x 400 x 120 mm, the Euro container's size. It takes the
    longest household object, a hammer of 0.33 m, in any pose. The lining is that of the
    table's mat, so that objects come to rest in it.
    """
    model = Model("bin", {"plastic": (0.25, 0.38, 0.52)}, "An open box on a table.")
    (x, y), wall, floor_, height = (0.3, 0.2), 0.015, 0.02, 0.12  # outside, half
    corners = {
        "floor": ((-x, -y, 0), (x, y, floor_)),
        "wall_front": ((x - wall, -y, floor_), (x, y, height)),
        "wall_rear": ((-x, -y, floor_), (wall - x, y, height)),
        "wall_left": ((wall - x, y - wall, floor_), (x - wall, y, height)),
        "wall_right": ((wall - x, -y, floor_), (x - wall, wall - y, height)),
    }
    pieces = [
        box_piece(f"bin_{name}", "plastic", low, high, 0.001, MAT)
        for name, (low, high) in corners.items()
    ]
    model.AddLink("bin", pieces, None)
    model.AddFrame("bottom", "bin")
    return model.finish("sdf/bin.sdf")


# Outside of the crate, thickness of its end walls, and top of its floor [m].
CRATE_SIZE, CRATE_GRIP, CRATE_FLOOR = (0.70, 0.26, 0.10), 0.05, 0.015
# Polypropylene of 900 kg/m3: floor, sides and hollow ends are 0.38 m2 of walls, which
# are 4.4 mm thick then. Each of two hands lifts 7.4 N.
CRATE_MASS = 1.5
# Polypropylene on dry rubber; softer than glaze, so that the crate comes to rest.
CRATE = Proximity(rigid=False, friction=0.6, modulus=1e6, dissipation=5.0)


def crate() -> Files:
    """Return a long open crate on its two end walls; the origin is underneath it.

    Its end walls are hollow bars, which a hand takes from above. The floor hangs 5 mm
    above the table.
    """
    (x, y, z), grip = (np.array(CRATE_SIZE) / (2, 2, 1)), CRATE_GRIP
    below, side, rim = 0.005, 0.008, 0.04
    corners = {
        "end_left": ((-x, -y, 0), (grip - x, y, z)),
        "end_right": ((x - grip, -y, 0), (x, y, z)),
        "floor": ((grip - x, -y, below), (x - grip, y, CRATE_FLOOR)),
        "side_front": ((grip - x, -y, CRATE_FLOOR), (x - grip, side - y, rim)),
        "side_rear": ((grip - x, y - side, CRATE_FLOOR), (x - grip, y, rim)),
    }
    model = Model("crate", {"plastic": (0.80, 0.10, 0.08)}, "Too wide for one hand.")
    pieces = [
        box_piece(f"crate_{name}", "plastic", low, high, 0.001, CRATE)
        for name, (low, high) in corners.items()
    ]
    solids = [piece.solid for piece in pieces]
    inertial = Inertial.uniform(CRATE_MASS, union_properties(solids))
    model.AddLink("crate", pieces, inertial)
    return model.finish("sdf/crate.sdf")


def crate_mark() -> Files:
    """Return the outline of the crate on the table; it has no collision geometry."""
    x, y, wide = 0.5 * CRATE_SIZE[0], 0.5 * CRATE_SIZE[1], 0.012
    bars = (
        ((-x - wide, -y - wide), (x + wide, -y)),
        ((-x - wide, y), (x + wide, y + wide)),
        ((-x - wide, -y), (-x, y)),
        ((x, -y), (x + wide, y)),
    )
    looks = {"outline": (0.15, 0.65, 0.25)}
    model = Model("crate_mark", looks, "Marks a goal of the crate, seen only.")
    solids = [block((*low, 0), (*high, 0.001)) for low, high in bars]
    pieces = [Piece(f"outline_{i}", "outline", s) for i, s in enumerate(solids)]
    inertial = Inertial.uniform(0.01, union_properties(solids))
    model.AddLink("crate_mark", pieces, inertial)
    return model.finish("sdf/crate_mark.sdf")


def can() -> Files:
    """Return the soup can: red ends and shoulders, a cream band around the middle."""
    name = "005_tomato_soup_can"
    looks = {"red": (0.80, 0.10, 0.08), "label": (0.93, 0.89, 0.78)}
    model = Model(name, looks, "YCB 005; one cylinder to touch.")
    r, h, count = CAN_RADIUS, CAN_LENGTH / 2, 64
    rim = [(r - 0.0002, h), (r, h - 0.0002), (r, h - 0.0022)]
    upper = revolve([*rim, (r - 0.0002, h - 0.0028), (r - 0.0002, h / 3)], count)
    lower = upper.moved(rot_x(np.pi))
    label = revolve([(r - 0.0001, h / 3), (r - 0.0001, -h / 3)], count)
    collision = Primitive("cylinder", (r, CAN_LENGTH))
    pieces = [
        Piece("can", "red", upper, collision, CAN),
        Piece("lower", "red", lower),
        Piece("label", "label", label),
    ]
    moment = CAN_MASS * (3 * r**2 + CAN_LENGTH**2) / 12
    inertia = np.diag([moment, moment, CAN_MASS * r**2 / 2])
    model.AddLink("can", pieces, Inertial(CAN_MASS, (0, 0, 0), inertia))
    return model.finish(f"sdf/{name}.sdf")


def build() -> Files:
    """Return the files of all props."""
    return {
        **table("table", WOOD, "A table"),
        **table("table_mat", MAT, "A table that objects come to rest on"),
        **table("table_long", MAT, "A table for two arms", "table_long", half=1.25),
        **floor(),
        **marker(),
        **lid(),
        **can(),
        **cradle(),
        **bin_(),
        **crate(),
        **crate_mark(),
        **pedestal(),
        **tray(),
        **belt(),
    }
