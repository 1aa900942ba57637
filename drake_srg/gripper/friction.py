"""Friction of the SRG's drive: in the gear train, and where the wires are guided."""

import dataclasses as dc
import math
from typing import Any

from pydrake.math import exp
from pydrake.math import max as max_
from pydrake.math import min as min_

# Travel after which a wire that reverses slides on its guides [m]: its stretch in
# there, about 10 mm at 1 %.
WIRE_PRESLIDING = 1e-4


@dc.dataclass(kw_only=True)
class DriveFrictionConfig:
    """Friction of gears and wires. Off by default: no data sheet states any of it."""

    # Friction of the gear train at the spool: a constant part [N m] and a share of the
    # wires' torque (the tooth forces' part; 1 cannot be driven back). The motor's stall
    # torque is that before this friction.
    gear: float = dc.field(default=0.0, metadata={"ge": 0.0})
    gear_load: float = dc.field(default=0.0, metadata={"ge": 0.0, "le": 1.0})
    # Capstan friction of a wire on its guides: coefficient times angle of wrap [rad].
    # The finger's end pulls with exp(-wire) of the spool's while the wire winds in,
    # and with exp(wire) while it pays out.
    wire: float = dc.field(default=0.0, metadata={"ge": 0.0, "le": 1.0})

    def of_gears(self, load: Any) -> Any:
        """Return the most that the gears take or hold [N m], for a load [N m]."""
        return self.gear + self.gear_load * load

    def motor_torque(self, load: float) -> float:
        """Return the torque that winds the spool against a load [N m]."""
        return load + float(self.of_gears(load))

    def load(self, motor_torque: float) -> float:
        """Return the load that a torque of the motor just winds against [N m]."""
        return (motor_torque - self.gear) / (1.0 + self.gear_load)


def slowed(speed: Any, most: Any) -> Any:
    """Return a speed after Coulomb friction, which stops it but never turns it.

    Args:
        speed: Without the friction [rad/s].
        most: By which the friction can change it in this step [rad/s].
    """
    return max_(speed - most, 0.0) + min_(speed + most, 0.0)


def slid(state: Any, travel: Any, presliding: float) -> Any:
    """Return how far a wire's friction has built up: -1 paying out .. 1 winding in.

    Args:
        state: Before the travel, -1 .. 1.
        travel: Of the wire along its guides towards the spool [m].
        presliding: Travel from no friction to sliding [m].
    """
    return max_(-1.0, min_(1.0, state + travel / presliding))


def passed_on(state: Any, friction: float) -> Any:
    """Return the share of the spool's pull that reaches the finger.

    Args:
        state: From `slid`.
        friction: Coefficient times angle of wrap [rad].
    """
    if isinstance(state, float):
        return math.exp(-friction * state)
    return exp(-friction * state)
