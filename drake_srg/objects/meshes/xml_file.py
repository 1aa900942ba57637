"""Reads URDF and SDF files that hold one free link."""

from __future__ import annotations

import contextlib
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.tree import RotationalInertia, SpatialInertia

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.meshes.contents import Contents, Geometry, MeshFile
from drake_srg.objects.sdf import DRAKE
from drake_srg.parsing import resolve_url
from drake_srg.types import Box, Cylinder, Shape, Sphere, Vector

_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def read_xml(path: Path, warnings: list[str]) -> ET.Element:
    """Return the tree of an XML file; Drake's namespace gets its usual name.

    Args:
        path: The file.
        warnings: Receives what was mended: an invalid header is left out.

    Raises:
        ScenarioError: If it cannot be read.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeError:
        raise ScenarioError(f"{path}: cannot be read: not text in UTF-8") from None
    text = re.sub(r"""xmlns:drake=(["'])[^"']*\1""", f'xmlns:drake="{DRAKE}"', text)
    try:
        return ET.fromstring(text)
    except ET.ParseError as error:
        # Public URDF files have headers such as `<xml version="0.0" ?>`.
        mended = re.sub(r"<\??xml\b[^>]*>", "", text, count=1).strip()
        try:
            root = ET.fromstring(mended)
        except ET.ParseError:
            raise ScenarioError(f"{path}: cannot be read: {error}") from None
        warnings.append("left out the invalid XML header")
        return root


def read_link(path: Path) -> Contents:
    """Read a URDF or SDF file with one free link.

    Raises:
        ScenarioError: If it cannot be read, has several links, or holds something else
            than boxes, cylinders, spheres and meshes.
    """
    warnings: list[str] = []
    root = read_xml(path, warnings)
    formats = {"robot": _Urdf, "sdf": _Sdf}
    if root.tag not in formats:
        raise ScenarioError(
            f"{path}: must hold <robot> (URDF) or <sdf>, got <{root.tag}>"
        )
    read = formats[root.tag](path)
    links = root.findall(read.link)
    if len(links) != 1:
        raise ScenarioError(
            f"{path}: must have one link, got {len(links)} (a single rigid body)"
        )
    visuals = [read.geometry(node) for node in links[0].findall("visual")]
    collisions = [read.geometry(node) for node in links[0].findall("collision")]
    if not visuals and not collisions:
        raise ScenarioError(f"{path}: its link has no geometry")
    if not collisions:
        warnings.append("no collision geometry: took the visual one")
    if not visuals:
        warnings.append("no visual geometry: took the collision one")
    mass, inertia = read.inertial(links[0])
    return Contents(
        path, visuals or collisions, collisions or visuals, inertia, mass, warnings
    )


class _Sdf:
    """Reads the elements of an SDF file, whose values are elements of their own."""

    link, mesh, color = "model/link", "uri", ("material", "diffuse")

    def __init__(self, path: Path) -> None:
        self._path = path

    def text(self, node: ET.Element | None, key: str) -> str | None:
        """Return the text of a value; None if it is missing."""
        return None if node is None else node.findtext(key)

    def pose(self, node: ET.Element) -> RigidTransform:
        """Return the pose of an element in the link."""
        pose = node.find("pose")
        if pose is None:
            return RigidTransform()
        if pose.get("relative_to") or pose.get("degrees", "false") != "false":
            raise ScenarioError(
                f"{self._path}: <pose>: must be in radians and relative to the link"
            )
        values = self._numbers("pose", pose.text, 6)
        return RigidTransform(RollPitchYaw(values[3:]), values[:3])

    def mass(self, inertial: ET.Element) -> str | None:
        """Return the text of the mass; None if it is missing."""
        return inertial.findtext("mass")

    def _numbers(self, key: str, text: str | None, count: int = 1) -> Vector:
        """Return the numbers in a text.

        Raises:
            ScenarioError: If there are others than `count` finite numbers.
        """
        try:
            values = np.array([float(word) for word in (text or "").split()])
        except ValueError:
            values = np.array([])
        if values.shape != (count,) or not np.all(np.isfinite(values)):
            needed = "a finite number" if count == 1 else f"{count} finite numbers"
            raise ScenarioError(f"{self._path}: {key}: needs {needed}, got {text!r}")
        return values

    def geometry(self, node: ET.Element) -> Geometry:
        """Return a visual or collision geometry."""
        shapes = node.findall("geometry/*")
        if len(shapes) != 1:
            raise ScenarioError(
                f"{self._path}: <{node.tag}>: needs one geometry, got {len(shapes)}"
            )
        material, key = self.color
        text = self.text(node.find(material), key)
        color = None if text is None else self._numbers(key, text, 4)
        return Geometry(
            self._shape(shapes[0]),
            self.pose(node),
            None if color is None else (color[0], color[1], color[2]),
            node.find(f"{{{DRAKE}}}proximity_properties"),
        )

    def _shape(self, node: ET.Element) -> Shape | MeshFile:
        def size(key: str, count: int = 1) -> Vector:
            values = self._numbers(key, self.text(node, key), count)
            if not np.all(values > 0.0):
                problem = f"must be greater than 0, got {values.tolist()}"
                raise ScenarioError(f"{self._path}: <{node.tag}> {key}: {problem}")
            return values

        match node.tag:
            case "box":
                return Box(size("size", 3).tolist())
            case "cylinder":
                return Cylinder(float(size("radius")[0]), float(size("length")[0]))
            case "sphere":
                return Sphere(float(size("radius")[0]))
            case "mesh":
                scale = self._numbers("scale", self.text(node, "scale") or "1 1 1", 3)
                uri = self.text(node, self.mesh) or ""
                return MeshFile(_resolved(self._path, uri.strip()), scale)
        raise ScenarioError(
            f"{self._path}: unknown geometry <{node.tag}> "
            "(allowed: box, cylinder, sphere, mesh)"
        )

    def inertial(self, link: ET.Element) -> tuple[float | None, SpatialInertia | None]:
        """Return a link's mass and spatial inertia; None if missing or invalid."""
        node = link.find("inertial")
        text = None if node is None else self.mass(node)
        if node is None or text is None:
            return None, None
        mass = float(self._numbers("mass", text)[0])
        X_LI = self.pose(node)
        found = [self.text(node.find("inertia"), key) for key in _MOMENTS]
        if not mass > 0.0 or None in found[:3]:
            return (mass if mass > 0.0 else None), None
        moments = [
            float(self._numbers(key, text or "0")[0])
            for key, text in zip(_MOMENTS, found, strict=True)
        ]
        try:
            I_I = RotationalInertia(*moments)
            return mass, SpatialInertia.MakeFromCentralInertia(
                mass, X_LI.translation(), I_I.ReExpress(X_LI.rotation())
            )
        except RuntimeError:  # no body has these moments
            return mass, None


class _Urdf(_Sdf):
    """Reads the elements of a URDF file, whose values are attributes."""

    link, mesh, color = "link", "filename", ("material/color", "rgba")

    def text(self, node: ET.Element | None, key: str) -> str | None:
        return None if node is None else node.get(key)

    def pose(self, node: ET.Element) -> RigidTransform:
        origin = node.find("origin")
        xyz, rpy = (
            self._numbers(key, self.text(origin, key) or "0 0 0", 3)
            for key in ("xyz", "rpy")
        )
        return RigidTransform(RollPitchYaw(rpy), xyz)

    def mass(self, inertial: ET.Element) -> str | None:
        return self.text(inertial.find("mass"), "value")


def _resolved(path: Path, uri: str) -> Path:
    """Return the file that a URI in a file names: relative, absolute or in a package.

    A package is ours, or a folder of that name above or beside the file.

    Raises:
        ScenarioError: If there is no such file.
    """
    scheme, colon, rest = uri.partition("://")
    name, _, inside = rest.partition("/")
    if not colon:
        candidates = [path.parent / uri]
    elif scheme == "file":
        candidates = [Path(rest)]
    else:  # package:// and Gazebo's model://
        above = path.resolve().parents
        candidates = [folder / name / inside for folder in above]
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    if scheme == "package" and name == "drake_srg":
        with contextlib.suppress(RuntimeError):
            return resolve_url(uri)
    raise ScenarioError(f"{path}: its mesh {uri!r} does not exist")
