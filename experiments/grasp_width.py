"""The widest box that the hand closes on, and the thinnest sheets and rods it holds.

The hand comes from above, closes on an object that stands on the table, lifts it and
shakes it gently. The object counts as held if at the end it touches only the gripper
and has not moved in the hand. Flat boxes are wrapped as in `clear_table`, with the palm
at the right height, too low and too high.

`low_things` uses a squeeze bottle, 94 mm wide and 58 mm high as it lies, which only the
tips touch. The hand takes it at some distance from its middle, lifts and shakes it.
"""

import dataclasses as dc
import itertools
from collections.abc import Sequence

import numpy as np
from pydrake.common.schema import Rotation, Transform

import experiments.runner as ex
from drake_srg.common.srg_geometry import SRG
from drake_srg.objects.config import ObjectConfig
from drake_srg.planning.grasps.srg_hand import SrgFingers
from drake_srg.simulation.rig import Rig, bench_scenario, shake
from drake_srg.types import Box, Cylinder
from experiments.data import household_objects
from experiments.stands.holding import is_free

CLAIM = 0.145  # figure of the SRG thesis [m]
# A cardboard box as heavy as the sugar box and tall enough for the pads [m], [kg].
_DEPTH, HEIGHT, _MASS, _FRICTION = 0.06, 0.12, 0.5, 0.6
# A cracker box on its widest side, but for its width [m], [kg]; friction as above.
# `clear_table` wraps it with the position driver.
_FLAT_LENGTH, _FLAT_HEIGHT, _FLAT_MASS = 0.2074, 0.0658, 0.411
_POSITION = "gripper=!SrgPositionDriver {underactuation: "
_CLEARING = f"{_POSITION}{{base: freeze, approach_speed: 1.0}}}}"
# Height of the palm frame above the top of a box, 3 mm below the open fingers' pads,
# and above the middle of the pads when straight fingers meet [m].
_ABOVE_BOX, _ABOVE_PADS = SRG.hinge_x + SRG.face_offset + 0.003, 0.158
_CLOSE, _LIFT, _HOLD = 2.5, 0.8, 3.0  # the wire force settles before the lift [s]
LIFT_HEIGHT = 0.1  # high, because wide boxes sink in the hand during the lift [m]
# Amplitude of the shake, vertical and along the pads, half of g [m/s²], and 2 Hz.
_SHAKE, _FREQUENCY = np.array([4.9, 0.0, 4.9]), 2.0
MOST_SLIP = 5.0  # of a held object during the shake [mm]
# Widths, thicknesses and diameters [m]: a bank card and a pencil come first.
SIZES = {
    "box": (0.05, 0.07, 0.09, 0.11, 0.13, 0.145, 0.16, 0.17, 0.18, 0.19),
    "sheet": (0.00076, 0.0003),
    "rod": (0.0072, 0.003, 0.001),
}
# Widths of flat boxes, and gaps between the base links and their tops [m].
FLAT, GAPS = (0.132, 0.145, 0.158, 0.165), (-0.001, 0.006, 0.01)


@dc.dataclass(frozen=True)
class Thing:
    """An object on the table, the height of the palm frame above it, and the grasp."""

    config: ObjectConfig
    z: float  # m
    closure: float = 1.0
    overrides: Sequence[str] = ()


def box(width: float) -> Thing:
    size = [_DEPTH, width, HEIGHT]
    config = ObjectConfig(shape=Box(size), mass=_MASS, friction=_FRICTION)
    return Thing(config, HEIGHT + _ABOVE_BOX)


def sheet(thickness: float) -> Thing:
    """Return the household card, of a thickness, on its short edge between the pads."""
    card = household_objects()["thin_card"]
    assert isinstance(card.shape, Box)
    length, width, original = card.shape.size
    card.mass = (card.mass or 0.0) * thickness / original
    card.shape = Box([width, thickness, length])
    return Thing(card, 0.7 * length + _ABOVE_PADS)


def rod(diameter: float) -> Thing:
    """Return the household pencil, of a diameter, on its end between the pads."""
    pencil = household_objects()["pencil"]
    assert isinstance(pencil.shape, Cylinder)
    radius, length = pencil.shape.radius, pencil.shape.length
    pencil.mass = (pencil.mass or 0.0) * (0.5 * diameter / radius) ** 2
    pencil.shape = Cylinder(0.5 * diameter, length)
    return Thing(pencil, 0.7 * length + _ABOVE_PADS)


def flat_box(width: float, gap: float) -> Thing:
    """Return a box whose upper edges the hand wraps around, below the base links."""
    fingers = SrgFingers()
    size = [_FLAT_LENGTH, width, _FLAT_HEIGHT]
    config = ObjectConfig(shape=Box(size), mass=_FLAT_MASS, friction=_FRICTION)
    z = _FLAT_HEIGHT + fingers.wrap.face_x + gap
    return Thing(config, z, fingers.wrapped(width).closure, [_CLEARING])


def grasp(thing: Thing) -> ex.Measures:
    """Close on an object on the table, lift it and shake it.

    `lean` is how far the pads lean outwards before the lift [deg]; `moved`, how far the
    object moves out of the hand from then on [mm].
    """
    home = np.array([0.0, 0.0, thing.z])
    up = home + np.array([0.0, 0.0, LIFT_HEIGHT])
    scenario = bench_scenario(thing.config, home=list(home), overrides=thing.overrides)
    with Rig(scenario, name="grasp_width") as rig:
        rig.advance(_CLOSE, closure=thing.closure)
        closed = rig.measured("gripper.state_measured")
        p_GO_closed = rig.X_GO().translation()
        rig.move(up, _LIFT)
        p_GO_lifted = rig.X_GO().translation()
        rig.advance(_HOLD, arm=shake(up, _SHAKE, _FREQUENCY, _HOLD))
        p_GO, free = rig.X_GO().translation(), is_free(rig)
    slip = 1e3 * np.linalg.norm(p_GO - p_GO_lifted)
    return {
        "free": float(free),
        "slip": slip,
        "held": bool(free and slip <= MOST_SLIP),
        "moved": 1e3 * (p_GO - p_GO_closed)[0],
        "lean": np.rad2deg(0.5 * np.pi - closed[[0, 2]].sum()),
    }


def cases() -> list[ex.Case]:
    """Grasp boxes from narrow to wide, then thin objects, then flat boxes."""
    found = []
    for kind, sizes in SIZES.items():
        for size in sizes:
            shown = f"{1e3 * size:.0f}" if kind == "box" else f"{1e3 * size:.2g}"
            found.append({"name": f"{kind}, {shown} mm", "kind": kind, "size": size})
    wrapped = [
        {"name": f"wrapped, {1e3 * c['size']:.0f} mm, gap {1e3 * c['gap']:.0f} mm", **c}
        for c in ex.grid(kind=["wrapped"], size=FLAT, gap=GAPS)
    ]
    return [case | {"gap": 0.0} for case in found] + wrapped


def trial(name: str, kind: str, size: float, gap: float) -> ex.Measures:
    makers = {"box": box, "sheet": sheet, "rod": rod}
    found = grasp(makers[kind](size) if kind in makers else flat_box(size, gap))
    if kind == "box":
        found["motion out of the hand [mm]"] = found["moved"]
    if kind != "box" or size <= CLAIM:
        found["free of its support []"] = found["free"]
        found["slip while shaken [mm]"] = found["slip"]
    return found


def whole(trials: ex.Trials) -> dict[str, ex.Values]:
    """Return the width up to which all boxes are held [mm], and the hand's opening."""
    boxes = trials.where(kind="box")
    held = itertools.takewhile(lambda t: t["held"], boxes)
    widest = max((1e3 * t["size"] for t in held), default=0.0)
    gap = "gap between parallel pads, bases open [mm]"
    return {
        "boxes": {"widest box held [mm]": widest},
        "hand": {gap: 1e3 * SRG.parallel_gap},
    }


grasp_width = ex.Experiment(
    "The widest box that the hand closes on, the thinnest sheets and rods it holds.",
    cases,
    trial,
    {
        "widest box held": ex.at_least(1e3 * CLAIM, source="thesis"),
        "gap between parallel pads, bases open": ex.within(
            1e3 * CLAIM, relative=0.01, source="thesis"
        ),
        "free of its support": ex.at_least(1.0),
        "slip while shaken": ex.at_most(MOST_SLIP),
    },
    whole=whole,
    picture=[
        ex.Bars(["slip while shaken"], log=True),
        ex.Points("size", "moved", where={"kind": "box"}, label=["held"]),
    ],
)

# Width and height of the bottle as it lies, and the middle of its mass above its bottom
# (squeeze_bottle.sdf) [m].
_WIDTH, _HEIGHT, _MIDDLE = 0.094, 0.058, 0.0704
# Where the hand is on the bench (gripper_bench.yaml), and how far the ends of its
# fingers stay above the table [m].
_BENCH_X, _GAP = 0.5, 0.012
OFFSETS = (-0.04, -0.03, -0.02, -0.01, 0.0, 0.01, 0.02, 0.03, 0.04)  # to the nozzle [m]
_CURL = f"{_POSITION}{{base: freeze, approach_speed: 1.0, tip: curl}}}}"
_SPRINGS = "{base_spring: {preload: 0.03}, tip_spring: {preload: 0.05}}"
HANDS = {
    "Algorithm 1": (_CURL.replace("curl", "algorithm_1"),),
    "tips that curl": (_CURL,),
    "tips that curl, half the step": (_CURL, "plant_config.time_step=0.001"),
    # As in `clear_table_tendon`.
    "wires": (f"gripper=!SrgTendonDriver {{drive: {_SPRINGS}}}",),
}


def bottle_trial(hand: str, offset: float) -> ex.Measures:
    bottle = household_objects()["squeeze_bottle"]
    bottle.pose = Transform()
    bottle.pose.translation = [_BENCH_X - _MIDDLE - offset, 0.0, 0.5 * _HEIGHT]
    bottle.pose.rotation = Rotation(value=Rotation.Rpy(deg=[90.0, 0.0, 90.0]))
    fingers = SrgFingers()
    closure = 1.0 if hand == "wires" else fingers.closed(_WIDTH).closure
    return grasp(Thing(bottle, fingers.deepest + _GAP, closure, HANDS[hand]))


low_things = ex.Experiment(
    "A lying squeeze bottle between tips that stay straight and tips that curl.",
    lambda: ex.grid(hand=HANDS, offset=OFFSETS),
    bottle_trial,
    {
        "share held": dict.fromkeys(HANDS, ex.number(spread=0.15))
        | {name: ex.at_least(0.85, spread=0.15) for name in HANDS if "curl" in name}
    },
    summary=lambda own: {
        "share held []": np.mean(own["free"]),
        "pads lean outwards, median [deg]": np.median(own["lean"]),
    },
    picture=[ex.Points("offset", "free")],
)
