"""The moment arms of an SRG finger's wire as functions of the joint angles.

tools/fit_moment_arms.py fits these polynomials to the arms of SAKE's public MuJoCo
model (drake_srg/experiments/data/tendon_moment_arms.csv), within 0.02 % (base, up to
2.007 rad) and 0.05 % (tip, up to 1.745 rad). The arms are separable: the base's depends
on the base angle alone, the tip's on the tip angle alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from drake_srg.types import Vector

# Coefficients, lowest power first [m, m/rad, ...].
_BASE = (
    *(6.482929e-3, 7.294326e-3, -3.261617e-4, -2.293250e-3),
    *(3.144639e-3, -2.975419e-3, 1.379180e-3, -2.771902e-4),
)
_TIP = (4.628336e-3, -2.780686e-5, -5.128206e-4, -1.948426e-4, 3.614142e-5)
_BASE_TRAVEL = (0.0, *(c / (i + 1) for i, c in enumerate(_BASE)))
_TIP_TRAVEL = (0.0, *(c / (i + 1) for i, c in enumerate(_TIP)))


def base_moment_arm(base: Any) -> Any:
    """Return the wire's arm about the base hinge [m] at a base angle [rad]."""
    return _polynomial(_BASE, base)


def tip_moment_arm(tip: Any) -> Any:
    """Return the wire's arm about the tip hinge [m] at a tip angle [rad]."""
    return _polynomial(_TIP, tip)


def wire_travel(base: Any, tip: Any) -> Any:
    """Return the length of wire that moves a finger from open to these angles [m].

    It is the integral of the moment arms, so the wire's work is the joints' work.

    Args:
        base: Base angle [rad].
        tip: Tip angle [rad].
    """
    return _polynomial(_BASE_TRAVEL, base) + _polynomial(_TIP_TRAVEL, tip)


def empty_hand(
    closure: float, full_scale: float, base_limit: float
) -> tuple[float, Vector]:
    """Return the wire travel [m] and the joints [rad] of an SRG that closes on nothing.

    A wire moves the base to its limit and then the tip, as Algorithm 1 does.

    Args:
        closure: 0 open .. 1 closed, clipped.
        full_scale: Base plus tip angle at closure 1 [rad].
        base_limit: Limit of the base, beyond which the tip closes [rad].
    """
    total = full_scale * min(max(closure, 0.0), 1.0)
    base = min(total, base_limit)
    tip = total - base
    return float(wire_travel(base, tip)), np.array([base, base, tip, tip])


def _polynomial(coefficients: tuple[float, ...], x: Any) -> Any:
    value: Any = 0.0
    for c in coefficients[::-1]:
        value = value * x + c
    return value
