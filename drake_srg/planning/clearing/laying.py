"""Laying a long load down in a bin, or setting a tall one down.

Two pads are a hinge: a long load may hang from them. Dropped like that, it falls on its
end and topples to any side, also over the rim. So the hand goes down on an arc around
that end, and the load lies in the end as it lay on the table. A load that is still
level comes to lie at the same place. What does not turn goes straight down.
"""

from __future__ import annotations

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.planning.clearing.destination import Spot
from drake_srg.planning.clearing.load import Load
from drake_srg.planning.motion.hand_target import HandTarget

# Height above what is below at which a load is let go [m]: more than it sags in the
# fingers, and little to fall.
_ABOVE = 0.02
# Angles of the load on its way from hanging to lying [rad].
_ANGLES = np.deg2rad([0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0])


def laying_targets(
    X_WG: RigidTransform, load: Load, palm: float, spot: Spot, high: float
) -> list[HandTarget]:
    """Return where the hand begins to lay a load down, and the way from there.

    It begins high over the end that hangs, and goes straight down to where the load
    stands on that end.

    Args:
        X_WG: The hand over the middle of the bin, as it drops things.
        load: The load.
        palm: Height of the palm above the underside of the level load [m].
        spot: Where it shall lie.
        high: World z of the palm at which the hanging load clears the rim [m].
    """
    middle_W = X_WG.rotation() @ load.middle_G
    outward = np.sign(load.middle_G[2]) * X_WG.rotation().col(2)[:2]
    p_W = X_WG.translation() + spot.aside_W - middle_W
    lying = np.array([*p_W[:2], spot.ground + _ABOVE + palm])
    angles = _ANGLES if load.sag > 0.0 else _ANGLES[-1:]
    arc = lying + load.sag * np.column_stack(
        [np.outer(1.0 - np.sin(angles), outward), np.cos(angles)]
    )
    begin = [*arc[0, :2], max(high, arc[0, 2])]
    return [HandTarget(p_W, X_WG.rotation()) for p_W in (np.array(begin), *arc)]
