"""Damping of contact, the same for each of Drake's contact approximations.

At the depth x and the rate of penetration v, contact presses with k x (1 + d v) by Hunt
and Crossley (`lagged`, `similar` and CENIC), and with k (x + tau v) by Kelvin and Voigt
(`sap`; Castro et al., 2022, call tau the relaxation time). The tau of two surfaces is
the sum of theirs, so rigid ones need tau = 0: they do not deform. Drake's default of
0.1 s is far from any solid: at 0.2 m/s a surface presses as if it were 20 mm deeper.
"""

# Depth at which both press alike [m]. Under 0.1 MPa, as between pads and objects in a
# firm grip, the fingers' pads give way by 0.4 mm, a can of hard plastic by 0.07 mm.
_DEPTH = 2e-4


def relaxation_time(dissipation: float) -> float:
    """Return tau [s] for a Hunt-Crossley dissipation d [s/m]."""
    return dissipation * _DEPTH
