"""Contact properties of objects that do not bring their own."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    ProximityProperties,
)
from pydrake.multibody.plant import CoulombFriction

from drake_srg.common.contact_damping import relaxation_time
from drake_srg.objects.sdf import DRAKE, AddChild

# Hydroelastic modulus [Pa] and Hunt-Crossley dissipation [s/m]. Much stiffer than the
# fingers' rubber (2 MPa), so that the pads deform, as they do on hard household
# objects.
MODULUS = 5.0e7
DISSIPATION = 5.0
# Edge length of the facets of round shapes, over the radius. It gives a circle 22 sides
# and an error within 1 % of the radius, as in the soup can's model.
_RESOLUTION = 0.3
FRICTION = 0.6  # of imported objects: dry cardboard, plastic or wood


def facet_length(radius: float) -> float:
    """Return the edge length of the facets that represent a round shape [m].

    Args:
        radius: Of the shape [m].
    """
    return _RESOLUTION * radius


def contact_properties(
    friction: float, modulus: float, resolution: float, dissipation: float
) -> ProximityProperties:
    """Return the contact properties of a shape.

    Args:
        friction: Coulomb's coefficient.
        modulus: Hydroelastic modulus [Pa].
        resolution: Edge length of facets [m].
        dissipation: Hunt and Crossley's [s/m].
    """
    properties = ProximityProperties()
    AddContactMaterial(
        dissipation=dissipation,
        friction=CoulombFriction(friction, friction),
        properties=properties,
    )
    properties.AddProperty("material", "relaxation_time", relaxation_time(dissipation))
    AddCompliantHydroelasticProperties(
        resolution_hint=resolution,
        hydroelastic_modulus=modulus,
        properties=properties,
    )
    return properties


def AddContact(collision: ET.Element, resolution: float | None = None) -> None:
    """Append the same contact properties to a collision element of an SDF.

    Args:
        collision: The element.
        resolution: Edge length of facets [m]; None for meshes, which have their own.
    """
    node = AddChild(collision, f"{{{DRAKE}}}proximity_properties")
    AddChild(node, f"{{{DRAKE}}}compliant_hydroelastic")
    for tag, value in (
        ("mesh_resolution_hint", resolution),
        ("hydroelastic_modulus", MODULUS),
        ("hunt_crossley_dissipation", DISSIPATION),
        ("relaxation_time", relaxation_time(DISSIPATION)),
        ("mu_dynamic", FRICTION),
        ("mu_static", FRICTION),
    ):
        if value is not None:
            AddChild(node, f"{{{DRAKE}}}{tag}", value)
