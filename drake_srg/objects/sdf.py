"""Elements of SDF files: builds them, and replaces an object's properties in them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.multibody.tree import SpatialInertia

DRAKE = "http://drake.mit.edu"  # the namespace of Drake's own tags
ET.register_namespace("drake", DRAKE)


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
    """Append a pose unless it is the identity."""
    pose = AddChild(parent, "pose", [*xyz, *rpy])
    if not np.any(np.abs([*xyz, *rpy]) > 0):
        parent.remove(pose)
    return pose


def is_placed(element: ET.Element) -> bool:
    """Return whether an element has a pose other than the identity."""
    return any(float(x) != 0.0 for x in (element.findtext("pose") or "").split())


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
    """Replace contact properties in a tree.

    Args:
        root: The tree.
        values: By tag without prefix, such as `mu_static`; None keeps the file's.
    """
    for element in root.iter():
        value = values.get(element.tag.rpartition("}")[2])
        if value is not None:
            element.text = repr(float(value))


def SetColor(root: ET.Element, color: Sequence[float]) -> None:
    """Give all visuals in a tree one colour: red, green, blue 0 .. 1."""
    for visual in root.iter("visual"):
        for material in visual.findall("material"):
            visual.remove(material)
        AddChild(AddChild(visual, "material"), "diffuse", [*color, 1.0])
