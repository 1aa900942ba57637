"""Boxes, sheets, rods and flat boxes, and the grasp that lifts and shakes them."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

import numpy as np

from drake_srg.common.srg_geometry import SRG
from drake_srg.experiments.data import household_objects
from drake_srg.objects.config import ObjectConfig
from drake_srg.planning.grasps.srg_hand import SrgFingers
from drake_srg.simulation.rig import Rig, bench_scenario, shake
from drake_srg.types import Box, Cylinder, Vector

# A cardboard box as heavy as the sugar box and tall enough for the pads [m], [kg].
_DEPTH, HEIGHT, _MASS, _FRICTION = 0.06, 0.12, 0.5, 0.6
# A cracker box on its widest side, but for its width [m], [kg]; friction as above.
# `clear_table` wraps it with the position driver.
_FLAT_LENGTH, _FLAT_HEIGHT, _FLAT_MASS = 0.2074, 0.0658, 0.411
_CLEARING = (
    "gripper=!SrgPositionDriver {underactuation: {base: freeze, approach_speed: 1.0}}",
)
# Height of the palm frame above the top of a box, 3 mm below the open fingers' pads,
# and above the middle of the pads when straight fingers meet [m].
_ABOVE_BOX, _ABOVE_PADS = SRG.hinge_x + SRG.face_offset + 0.003, 0.158
_CLOSE, _LIFT, _HOLD = 2.5, 0.8, 3.0  # the wire force settles before the lift [s]
LIFT_HEIGHT = 0.1  # high, because wide boxes sink in the hand during the lift [m]
# Amplitude of the shake, vertical and along the pads, half of g [m/s²], and 2 Hz.
_SHAKE, _FREQUENCY = np.array([4.9, 0.0, 4.9]), 2.0
MOST_SLIP = 0.005  # of a held object during the shake [m]


@dc.dataclass(frozen=True)
class Thing:
    """An object to grasp, and the height at which the hand closes.

    Attributes:
        name: Shown in tables and figures.
        size: The width of a box, the thickness of a sheet or rod [m].
        config: The object; it stands on the table.
        z: Height of the palm frame above the table [m].
        closure: Command that closes the hand.
        overrides: Of the bench's scenario.
    """

    name: str
    size: float
    config: ObjectConfig
    z: float
    closure: float = 1.0
    overrides: Sequence[str] = ()


@dc.dataclass(frozen=True)
class Grasp:
    """The outcome of a grasp.

    Attributes:
        free: Whether only the gripper touches the object at the end.
        raised: Height of the object above the table at the end [m].
        slip: Motion in the hand during the shake [m].
        closed: Left base and tip angle before the lift, shape (2,) [rad].
        lifted: The same at the end.
        top: x of the object's top in the palm frame, before the lift and at the end
            [m].
    """

    free: bool
    raised: float
    slip: float
    closed: Vector
    lifted: Vector
    top: tuple[float, float]

    @property
    def moved(self) -> float:
        """Motion of the object out of the hand, away from the palm [m]."""
        return self.top[1] - self.top[0]

    @property
    def held(self) -> bool:
        """Whether the object was held to the end."""
        return self.free and self.slip <= MOST_SLIP


def box(width: float) -> Thing:
    """Return a box that stands between the fingers."""
    size = [_DEPTH, width, HEIGHT]
    config = ObjectConfig(shape=Box(size), mass=_MASS, friction=_FRICTION)
    return Thing(f"box, {1e3 * width:.0f} mm", width, config, HEIGHT + _ABOVE_BOX)


def sheet(thickness: float) -> Thing:
    """Return a card on its short edge, with the pads across its upper part.

    Outline, density and friction are those of the household card.
    """
    card = household_objects()["thin_card"]
    assert isinstance(card.shape, Box)
    length, width, original = card.shape.size
    card.mass = (card.mass or 0.0) * thickness / original
    card.shape = Box([width, thickness, length])
    name = f"sheet, {1e3 * thickness:.2g} mm"
    return Thing(name, thickness, card, 0.7 * length + _ABOVE_PADS)


def rod(diameter: float) -> Thing:
    """Return a pencil on its end, with the pads along its upper part.

    Length, density and friction are those of the household pencil.
    """
    pencil = household_objects()["pencil"]
    assert isinstance(pencil.shape, Cylinder)
    radius, length = pencil.shape.radius, pencil.shape.length
    pencil.mass = (pencil.mass or 0.0) * (0.5 * diameter / radius) ** 2
    pencil.shape = Cylinder(0.5 * diameter, length)
    name = f"rod, {1e3 * diameter:.2g} mm"
    return Thing(name, diameter, pencil, 0.7 * length + _ABOVE_PADS)


def flat_box(width: float, gap: float) -> Thing:
    """Return a box below the open hand, which wraps around its upper edges.

    Args:
        width: Of the box [m].
        gap: Between its top and the base links [m].
    """
    fingers = SrgFingers()
    size = [_FLAT_LENGTH, width, _FLAT_HEIGHT]
    return Thing(
        f"wrapped, {1e3 * width:.0f} mm, gap {1e3 * gap:.0f} mm",
        width,
        ObjectConfig(shape=Box(size), mass=_FLAT_MASS, friction=_FRICTION),
        _FLAT_HEIGHT + fingers.wrap.face_x + gap,
        fingers.wrapped(width).closure,
        _CLEARING,
    )


def grasp(thing: Thing) -> Grasp:
    """Close on an object on the table, lift it and shake it."""
    home = np.array([0.0, 0.0, thing.z])
    up = home + np.array([0.0, 0.0, LIFT_HEIGHT])
    scenario = bench_scenario(thing.config, home=list(home), overrides=thing.overrides)
    with Rig(scenario, name="grasp_width") as rig:
        start = rig.X_WO().translation()
        rig.advance(_CLOSE, closure=thing.closure)
        closed, X_GO_closed = rig.measured("gripper.state_measured"), rig.X_GO()
        rig.move(up, _LIFT)
        X_GO_lifted = rig.X_GO()
        rig.advance(_HOLD, arm=shake(up, _SHAKE, _FREQUENCY, _HOLD))
        lifted, X_GO = rig.measured("gripper.state_measured"), rig.X_GO()
        free = set(rig.contact_forces()) == {"gripper"}
        raised = float((rig.X_WO().translation() - start)[2])
    slip = float(np.linalg.norm(X_GO.translation() - X_GO_lifted.translation()))
    tops = [float(X.translation()[0]) - float(start[2]) for X in (X_GO_closed, X_GO)]
    return Grasp(
        free=free,
        raised=raised,
        slip=slip,
        closed=closed[[0, 2]],
        lifted=lifted[[0, 2]],
        top=(tops[0], tops[1]),
    )
