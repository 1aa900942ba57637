"""SDF elements of objects, and their contact properties."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    ProximityProperties,
)
from pydrake.multibody.plant import CoulombFriction
from pydrake.multibody.tree import SpatialInertia

from drake_srg.common.contacts import relaxation_time
from drake_srg.common.exceptions import ScenarioError

DRAKE = "http://drake.mit.edu"  # the namespace of Drake's own tags
ET.register_namespace("drake", DRAKE)
PROXIMITY = f"{{{DRAKE}}}proximity_properties"


def AddChild(
    parent: ET.Element, tag: str, text: object = None, **attributes: str
) -> ET.Element:
    """Append a child element and return it."""
    child = ET.SubElement(parent, tag, attributes)
    if text is not None:
        child.text = text if isinstance(text, str) else sdf_text(text)
    return child


def sdf_text(value: object) -> str:
    """Return numbers as SDF text."""
    values = np.atleast_1d(np.asarray(value, float))
    return " ".join(_significant(x) for x in values)


def _significant(x: float) -> str:
    text = f"{x:.12g}"
    if "e" in text and abs(x) < 1e-4:
        return "0" if abs(x) < 1e-12 else f"{x:.5g}"
    return "0" if text == "-0" else text


def AddPose(
    parent: ET.Element, xyz: Sequence[float], rpy: Sequence[float] = (0, 0, 0)
) -> ET.Element:
    """Append a pose unless it is the identity; return the pose's element."""
    pose = AddChild(parent, "pose", [*xyz, *rpy])
    if not np.any(np.abs([*xyz, *rpy]) > 0):
        parent.remove(pose)
    return pose


def is_placed(element: ET.Element) -> bool:
    """Return whether an element may have a pose other than the identity."""
    pose = element.find("pose")
    if pose is None:
        return False
    return bool(pose.get("relative_to")) or any(map(float, (pose.text or "").split()))


def AddInertial(link: ET.Element, M_LLo_L: SpatialInertia) -> None:
    """Append the inertial element of a link.

    Args:
        link: The link L.
        M_LLo_L: Its spatial inertia about its origin [kg, m].
    """
    inertial = AddChild(link, "inertial")
    com = M_LLo_L.get_com()
    AddPose(inertial, com)
    AddChild(inertial, "mass", M_LLo_L.get_mass())
    matrix = AddChild(inertial, "inertia")
    central = M_LLo_L.Shift(com).CalcRotationalInertia().CopyToFullMatrix3()
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        AddChild(matrix, "i" + "xyz"[i] + "xyz"[j], f"{central[i, j]:.9g}")


def SetMass(root: ET.Element, mass: float) -> None:
    """Scale the mass and the inertia in a tree to a mass [kg]."""
    masses = root.findall(".//inertial/mass")
    scale = mass / sum(float(m.text or 0.0) for m in masses)
    for element in (*masses, *root.findall(".//inertial/inertia/*")):
        element.text = repr(float(element.text or 0.0) * float(scale))


def SetContact(root: ET.Element, values: Mapping[str, float | None]) -> None:
    """Set the contact properties of all collisions in a tree that have any.

    Args:
        root: The tree.
        values: New values by tag without prefix, such as `mu_static`; None keeps the
            file's value.
    """
    given = {key: value for key, value in values.items() if value is not None}
    for node in root.iter(PROXIMITY):
        for key, value in given.items():
            tag = f"{{{DRAKE}}}{key}"
            child = node.find(tag)
            (AddChild(node, tag) if child is None else child).text = repr(float(value))


def SetColor(root: ET.Element, color: Sequence[float]) -> None:
    """Give all visuals in a tree one colour: red, green, blue 0 .. 1."""
    for visual in root.iter("visual"):
        for material in visual.findall("material"):
            visual.remove(material)
        AddChild(AddChild(visual, "material"), "diffuse", [*color, 1.0])


# Hydroelastic modulus [Pa] and Hunt-Crossley dissipation [s/m]. The modulus is much
# higher than that of the fingers' rubber (2 MPa), so mainly the pads deform, as on real
# hard objects.
MODULUS = 5.0e7
DISSIPATION = 5.0
# Edge length of the facets of round shapes, over the radius: a circle gets 22 sides,
# with an error below 1 % of the radius, as in the soup can's model.
_RESOLUTION = 0.3
FRICTION = 0.6  # of imported objects: dry cardboard, plastic or wood


def facet_length(radius: float) -> float:
    """Return the edge length of the facets that represent a round shape [m].

    Args:
        radius: Radius of the shape [m].
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
        dissipation: Hunt-Crossley dissipation [s/m].
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


def ode_friction(collision: ET.Element, path: Path) -> tuple[float, float] | None:
    """Return the friction coefficients in an SDF collision's `surface` element.

    Returns:
        Static and dynamic coefficient, from `mu` and `mu2` as in Drake; None if they
        are missing.

    Raises:
        ScenarioError: If they are not valid coefficients.
    """
    ode = collision.find("surface/friction/ode")
    if ode is None or ode.find("mu") is None:
        return None
    try:
        mu = float(ode.findtext("mu") or "")
        mu2 = float(ode.findtext("mu2") or mu)
    except ValueError:
        mu = mu2 = float("nan")
    if not mu >= mu2 >= 0.0:
        raise ScenarioError(
            f"{path}: <surface>: <friction>: needs mu >= mu2 >= 0 (static, dynamic)"
        )
    return mu, mu2


def AddContact(
    collision: ET.Element,
    resolution: float | None = None,
    friction: tuple[float, float] | None = None,
    own: ET.Element | None = None,
) -> None:
    """Append contact properties to a collision element of an SDF.

    Args:
        collision: The element.
        resolution: Edge length of facets [m]; None for meshes, which have their own.
        friction: Static and dynamic coefficient, unless `own` has them; None: ours.
        own: Contact properties from the file, kept as they are; None for those of an
            object with a `shape`.
    """
    static, dynamic = friction or (FRICTION, FRICTION)
    node = AddChild(collision, PROXIMITY) if own is None else copy.deepcopy(own)
    if own is not None:
        collision.append(node)
        if friction is not None and node.find(f"{{{DRAKE}}}mu_static") is None:
            AddChild(node, f"{{{DRAKE}}}mu_dynamic", dynamic)
            AddChild(node, f"{{{DRAKE}}}mu_static", static)
        return
    AddChild(node, f"{{{DRAKE}}}compliant_hydroelastic")
    for tag, value in (
        ("mesh_resolution_hint", resolution),
        ("hydroelastic_modulus", MODULUS),
        ("hunt_crossley_dissipation", DISSIPATION),
        ("relaxation_time", relaxation_time(DISSIPATION)),
        ("mu_dynamic", dynamic),
        ("mu_static", static),
    ):
        if value is not None:
            AddChild(node, f"{{{DRAKE}}}{tag}", value)
