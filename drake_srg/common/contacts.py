"""Contacts of a plant, and their damping.

At a penetration of x with the rate v, the contact force is k x (1 + d v) by Hunt and
Crossley (`lagged`, `similar` and CENIC), and k (x + tau v) by Kelvin and Voigt (`sap`;
Castro et al., 2022, call tau the relaxation time). The tau of a contact is the sum of
both surfaces' tau. Rigid surfaces do not deform, so theirs must be 0. Drake's default
of 0.1 s fits no solid: at 0.2 m/s, the force is that of a contact 20 mm deeper.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ContactResults, PointPairContactInfo

from drake_srg.types import Vector

# Penetration at which both laws give the same force [m]. Under 0.1 MPa, typical of a
# firm grip, the fingers' pads give way by 0.4 mm, a can of hard plastic by 0.07 mm.
_DEPTH = 2e-4


def relaxation_time(dissipation: float) -> float:
    """Return tau [s] for a Hunt-Crossley dissipation d [s/m]."""
    return dissipation * _DEPTH


class Contact(NamedTuple):
    """A contact between two geometries A and B.

    Attributes:
        id_A: Number of geometry A, from `GeometryId.get_value()`.
        id_B: Number of geometry B.
        p_WC: Computes the point C of application in world, shape (3,) [m].
        F_Ac_W: Computes the spatial force on A at C in world [N m, N].
    """

    id_A: int
    id_B: int
    p_WC: Callable[[], Vector]
    F_Ac_W: Callable[[], SpatialForce]


def each_contact(results: ContactResults) -> Iterator[Contact]:
    """Yield hydroelastic contacts, then those of soft bodies, then point contacts."""
    for k in range(results.num_hydroelastic_contacts()):
        info = results.hydroelastic_contact_info(k)
        surface = info.contact_surface()
        yield Contact(
            surface.id_M().get_value(),
            surface.id_N().get_value(),
            surface.centroid,
            info.F_Ac_W,
        )
    for k in range(results.num_deformable_contacts()):
        soft = results.deformable_contact_info(k)
        yield Contact(
            soft.id_A().get_value(),
            soft.id_B().get_value(),
            soft.contact_mesh().centroid,
            soft.F_Ac_W,
        )
    for k in range(results.num_point_pair_contacts()):
        pair = results.point_pair_contact_info(k)
        yield Contact(
            pair.point_pair().id_A.get_value(),
            pair.point_pair().id_B.get_value(),
            pair.contact_point,
            functools.partial(_point_force, pair),
        )


def _point_force(pair: PointPairContactInfo) -> SpatialForce:
    # Drake reports the force on B.
    return SpatialForce(tau=np.zeros(3), f=-pair.contact_force())
