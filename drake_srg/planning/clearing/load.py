"""What is known of a load before it is lifted."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.planning.clearing.columns import thing_at
from drake_srg.planning.clearing.destination import Spot
from drake_srg.types import HeightMap, Vector

# A load turns about the line between the pads until it hangs from them, but no
# household object by more than `_MOST_SAG` [m] below where it lay: the hammer, held by
# its head, has a handle of 0.32 m. What reaches further than `_LONG` from the grasp may
# hang beside where it lay [m].
_MOST_SAG, _LONG = 0.22, 0.1
# Things that touch are parted by a step of this height [m]: more than noise makes.
_STEP = 0.015
# What hangs further below the grasp and is let go above the rim may topple over it [m].
_TALL = 0.1
# Greatest offset in x and y of the hand from the bin's middle when it lets go [m].
_ASIDE = 0.12


@dc.dataclass(frozen=True)
class Load:
    """What is known of a load before it is lifted."""

    p_GC: Vector  # the grasp in the hand, shape (3,) [m]
    below: float  # how far it hangs below the grasp [m]
    sag: float  # how much further it may hang, turned in the hand [m]
    long: bool  # it needs the whole bin
    # From the grasp to where its middle may be expected, level, in the hand, (3,) [m].
    middle_G: Vector
    # From the bin's middle to where it is dropped, in world, shape (3,) [m].
    aside_W: Vector = dc.field(default_factory=lambda: np.zeros(3))
    piled: float = 0.0  # how far what is in the bin rises above its rim [m]
    spots: tuple[Spot, ...] = ()  # where it may be laid down, the best one first

    @property
    def may_hang(self) -> bool:
        """Whether it may hang far below the hand when it is let go."""
        return self.long and self.sag > 0.0

    @property
    def tall(self) -> bool:
        """Whether it does not hang, but might topple over the rim."""
        return self.below > _TALL and not self.may_hang

    @property
    def expected_middle(self) -> Vector:
        """From the grasp to where its middle errs least, in the hand, (3,) [m].

        A long load is level, or hangs below the hand: halfway between.
        """
        return 0.5 * self.middle_G if self.long else self.middle_G

    @property
    def level(self) -> Load:
        """The same load if it does not turn in the hand, and the bin is not full."""
        return dc.replace(self, sag=0.0, piled=0.0)

    @classmethod
    def seen(
        cls, X_WG: RigidTransform, p_WC: Vector, height_map: HeightMap, table: float
    ) -> Load:
        """Return what a map shows of a load.

        Args:
            X_WG: The hand's pose at the grasp [m].
            p_WC: The grasp, shape (3,) [m].
            height_map: Of the table before.
            table: Height of the table [m].
        """
        # Its neighbours may hang from it, but do not move its middle.
        all_away = _away(height_map, table, p_WC)
        across_W = X_WG.rotation().matrix()[:2, 2]  # of the line between the pads
        hangs = float(np.max(np.abs(all_away @ across_W)))
        below = max(float(p_WC[2]) - table, 0.01)
        long = bool(np.max(np.linalg.norm(all_away, axis=1)) > _LONG)
        away = _away(height_map, table, p_WC, _STEP)
        middle = np.clip(0.5 * (away.min(axis=0) + away.max(axis=0)), -_ASIDE, _ASIDE)
        return cls(
            p_GC=X_WG.inverse() @ p_WC,
            below=below,
            sag=min(max(hangs - below, 0.0), _MOST_SAG),
            long=long,
            middle_G=X_WG.rotation().inverse() @ np.array([*middle, 0.0]),
        )


def _away(
    height_map: HeightMap, table: float, p_WC: Vector, step: float = np.inf
) -> Vector:
    """Return where the cells of the thing at a grasp are from there, (n, 2) [m]."""
    away: Vector = thing_at(height_map, table, p_WC, step) - p_WC[:2]
    return away
