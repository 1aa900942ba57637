"""Standard-size hobby servos: data sheets and geometry."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Sequence

import numpy as np
from pydrake.math import RollPitchYaw, RotationMatrix

from .pieces import Piece, Primitive, Proximity, box_piece
from .shapes import Points, Solid, disc, prism

KGF_CM = 0.0980665  # N m


# kg m^2. The SO-ARM100 project uses 0.028 kg m^2 at the output of the Feetech STS3215,
# a servo of this size with a 345:1 gear (TheRobotStudio/SO-ARM100,
# Simulation/SO101/joints_properties.xml).
ROTOR_INERTIA = 0.028 / 345**2
# Current at no load as a fraction of the stall current (TowerPro MG995: 170 of 1,200
# mA).
NO_LOAD_CURRENT = 0.14


@dc.dataclass(frozen=True)
class Servo:
    """A hobby servo's data sheet values, and how many such servos share a joint."""

    stall_torque: float  # N m
    no_load_speed: float  # rad/s
    gear_ratio: float
    count: int = 1

    # Half the stall torque up to half the no-load speed: the largest rectangle under
    # the straight torque-speed line.

    @property
    def effort(self) -> float:
        """Torque limit of the joint [N m]."""
        return self.count * self.stall_torque / 2

    @property
    def velocity(self) -> float:
        """Speed limit of the joint [rad/s]."""
        return self.no_load_speed / 2

    @property
    def rotor_inertia(self) -> float:
        """Inertia of all rotors on the motor side of the gears [kg m^2]."""
        return self.count * ROTOR_INERTIA

    @property
    def damping(self) -> float:
        """The friction behind the no-load current, as viscous damping [N m s/rad]."""
        friction = NO_LOAD_CURRENT * self.count * self.stall_torque
        return friction / self.no_load_speed


# DSServo DS3235SG at 7.4 V: 35 kgf cm, 0.12 s for 60 degrees, 270 degrees, 60 g
# (plexrobotics.com/en/products/dsservo-ds3235sg-35kg-servo). The gear ratio is that of
# the Hiwonder HPS-3527SG, a servo of the same case, mass and class.
DS3235SG = Servo(35 * KGF_CM, np.pi / 3 / 0.12, 342.0)
# DFRobot DSS-M15S at 7 V: 12 kgf cm, 0.16 s for 60 degrees, 270 degrees, 310:1
# (wiki.dfrobot.com, SER0044).
DSS_M15S = Servo(12 * KGF_CM, np.pi / 3 / 0.16, 310.0)
# kg: 60 g, and 5 g for horn, screws and wire. The page of the DSS-M15S gives no mass,
# but its case is the same.
MASS = 0.065

# Plastic on wood or plastic. The arm should not touch anything.
PLASTIC = Proximity(rigid=True, friction=0.4, resolution=0.02)

# The standard servo's case [m]: extents behind and in front of the output axis, half
# the width, then depths below the horn's outer face, and the mounting ears.
BEHIND, BEFORE, HALF_WIDTH = 0.030, 0.010, 0.010
TOP, BOTTOM = 0.004, 0.0425
EARS, EARS_TOP, EARS_BOTTOM = 0.007, 0.0145, 0.017

Part = tuple[float, list[Piece]]  # mass [kg], spread evenly over the pieces


plastic_box = functools.partial(box_piece, bevel=0.0008, proximity=PLASTIC)


def placed(pieces: Sequence[Piece], R: Points, p: Sequence[float]) -> list[Piece]:
    """Return the pieces, rotated by R and then translated by p."""

    def touched(shape: Primitive | Solid | None) -> Primitive | Solid | None:
        if isinstance(shape, Solid):
            return shape.moved(R, p)
        if isinstance(shape, Primitive):
            turned = RotationMatrix(R) @ RotationMatrix(RollPitchYaw(shape.rpy))
            rpy = np.round(RollPitchYaw(turned).vector(), 12) + 0.0
            return dc.replace(shape, xyz=tuple(R @ shape.xyz + p), rpy=tuple(rpy))
        return shape

    return [
        dc.replace(
            piece, solid=piece.solid.moved(R, p), collision=touched(piece.collision)
        )
        for piece in pieces
    ]


def servo_part(name: str, R: Points, p: Sequence[float]) -> Part:
    """Return a servo whose horn ends at p, output axis along R's z, case along -x."""
    horn = prism(disc(0.010), -0.003, 0, 0.0003)
    boss = prism(disc(0.006), -TOP - 0.0001, -0.002)
    pieces = [
        plastic_box(
            f"{name}_case",
            "case",
            (-BEHIND, -HALF_WIDTH, -BOTTOM),
            (BEFORE, HALF_WIDTH, -TOP),
        ),
        plastic_box(
            f"{name}_ears",
            "case",
            (-BEHIND - EARS, -HALF_WIDTH, -EARS_BOTTOM),
            (BEFORE + EARS, HALF_WIDTH, -EARS_TOP),
        ),
        Piece(f"{name}_horn", "horn", horn, horn, PLASTIC),
        Piece(f"{name}_boss", "case", boss),
    ]
    return MASS, placed(pieces, R, p)
