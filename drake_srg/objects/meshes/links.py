"""Readers of links in URDF and SDF files, among them objects with one link."""

from __future__ import annotations

import contextlib
import copy
import dataclasses as dc
import itertools
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import NoReturn
from urllib.parse import unquote

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.tree import RotationalInertia, SpatialInertia

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.meshes.files import Color, Contents, Geometry, MeshFile
from drake_srg.objects.meshes.sources import decoded, read_bytes
from drake_srg.objects.sdf import DRAKE, PROXIMITY, ode_friction
from drake_srg.parsing import models_path
from drake_srg.types import Box, Cylinder, Shape, Sphere, Vector

_DEEPEST = 500  # elements; more would crash the reader
_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def read_xml(path: Path, warnings: list[str]) -> ET.Element:
    """Return the tree of an XML file; Drake's namespace gets its usual name.

    Args:
        path: The file.
        warnings: Receives the mended defects: an invalid header is removed.

    Raises:
        ScenarioError: If the file cannot be read, or is an input of xacro.
    """
    text = re.sub(
        "<!--.*?-->",
        lambda comment: "\n" * comment[0].count("\n"),  # errors name the line
        decoded(read_bytes(path)),
        flags=re.DOTALL,
    )
    text = re.sub(r"""xmlns:drake=(["'])[^"']*\1""", f'xmlns:drake="{DRAKE}"', text)
    if re.search(r"<xacro:|=[\"'][^\"'<]*\$\{", text):
        raise ScenarioError(
            f"{path}: is an input of xacro (write its output: xacro {path.name} > "
            f"{path.stem}_plain.urdf)"
        )
    tags = re.findall(r"<(/?)[\w:.-]+[^<>]*?(/?)>", text)
    steps = [-1 if end else int(not alone) for end, alone in tags]
    if max(itertools.accumulate(steps), default=0) > _DEEPEST:
        raise ScenarioError(f"{path}: is nested more than {_DEEPEST} elements deep")
    # Drake reads undeclared prefixes.
    prefixes = set(re.findall(r"</?([A-Za-z_][\w.-]*):", text))
    prefixes |= set(re.findall(r"""\s([A-Za-z_][\w.-]*):[\w.-]+\s*=\s*["']""", text))
    prefixes -= {"xml", "xmlns"}
    for prefix in sorted(p for p in prefixes if f"xmlns:{p}=" not in text):
        name = DRAKE if prefix == "drake" else prefix
        text = re.sub(r"<(sdf|robot)\b", rf'<\1 xmlns:{prefix}="{name}"', text, count=1)
    try:
        return ET.fromstring(text)
    except (ET.ParseError, ValueError) as error:
        # Public URDF files have headers such as `<xml version="0.0" ?>`.
        mended = re.sub(r"<\??xml\b[^>]*>", "", text, count=1).strip()
        try:
            root = ET.fromstring(mended)
        except (ET.ParseError, ValueError):
            raise ScenarioError(f"{path}: cannot be read: {error}") from None
        warnings.append("left out the invalid XML header")
        return root


def is_complete(path: Path, root: ET.Element) -> bool:
    """Return whether Drake can read a tree unchanged, as an object.

    It can if the tree is an SDF with a valid inertia and convex collision pieces.

    Args:
        path: The tree's file.
        root: The tree.

    Raises:
        ScenarioError: If it is an SDF, but does not have one free link, or has wrong
            numbers.
    """
    if root.tag != "sdf":
        return False
    read = SdfReader(path, root, [])
    link = read.single_link()
    for node in (*link.findall("visual"), *link.findall("collision")):
        for shape in node.findall("geometry/*"):
            if shape.tag in _SHAPES:
                read.shape(shape)
        read.color(node)
        if not any(pose.get("relative_to") for pose in node.findall("pose")):
            read.pose(node)
    meshes = link.findall("collision/geometry/mesh")
    convex = [mesh.find(f"{{{DRAKE}}}declare_convex") is not None for mesh in meshes]
    return all(convex) and read.inertial(link)[1] is not None


def read_link(path: Path) -> Contents:
    """Read a URDF or SDF file with one free link.

    Raises:
        ScenarioError: If it cannot be read, has several links, or has geometry other
            than boxes, cylinders, spheres and meshes.
    """
    read = open_model(path)
    link, warnings = read.single_link(), read.warnings
    found = read.contents(link)
    if not found.visuals and not found.collisions:
        raise ScenarioError(f"{path}: its link has no geometry")
    if not found.collisions:
        warnings.append("no collision geometry: took the visual one")
    if not found.visuals:
        warnings.append("no visual geometry: took the collision one")
    if any(read.root.find(f".//{tag}") is not None for tag in _OTHER_FRICTION):
        warnings.append("its friction for other simulators is not read: set --friction")
    return dc.replace(
        found,
        visuals=found.visuals or found.collisions,
        collisions=found.collisions or found.visuals,
    )


def open_model(path: Path) -> SdfReader:
    """Return the reader of a URDF or SDF file.

    Raises:
        ScenarioError: If it cannot be read, or is another kind of file.
    """
    warnings: list[str] = []
    root = read_xml(path, warnings)
    formats = {"robot": UrdfReader, "sdf": SdfReader}
    if root.tag not in formats:
        raise ScenarioError(
            f"{path}: must hold <robot> (URDF) or <sdf>, got <{root.tag}>"
        )
    return formats[root.tag](path, root, warnings)


_SHAPES = ("box", "cylinder", "sphere", "mesh")
# Elements of Gazebo's and Bullet's extensions of URDF.
_OTHER_FRICTION = ("gazebo//mu1", "contact/lateral_friction", "contact_coefficients")


class SdfReader:
    """Reads the elements of an SDF file. Their values are child elements.

    Attributes:
        path: The file.
        root: Its tree.
        warnings: Receives the mended defects.
    """

    link, joint, mesh = "model/link", "model/joint", "uri"

    def __init__(self, path: Path, root: ET.Element, warnings: list[str]) -> None:
        self.path = path
        self.root = root
        self.warnings = warnings

    def contents(self, link: ET.Element) -> Contents:
        """Return the contents of a link."""
        self._name = link.get("name")
        visuals = [self.geometry(node) for node in link.findall("visual")]
        collisions = [self.geometry(node) for node in link.findall("collision")]
        mass, inertia = self.inertial(link)
        return Contents(self.path, visuals, collisions, inertia, mass, self.warnings)

    def single_link(self) -> ET.Element:
        """Return the only link.

        Raises:
            ScenarioError: If there is not exactly one link, or it cannot move freely.
        """
        found = self.root.findall(self.link)
        links = [link for link in found if link.get("drake_ignore") != "true"]
        if len(links) != 1:
            self._refuse(f"must have one link, got {len(links)} (a single rigid body)")
        for tag in ("include", "model", "joint"):
            if self.root.find(f"model/{tag}") is not None:
                self._refuse(f"<{tag}> in its model: an object is one rigid body")
        if (self.root.findtext("model/static") or "").strip() in ("true", "1"):
            self._refuse("<static>: must be false: an object moves freely")
        self._name = links[0].get("name")
        return links[0]

    _name: str | None = None  # of the link that is being read

    def _refuse(self, problem: str) -> NoReturn:
        raise ScenarioError(f"{self.path}: {problem}")

    def text(self, node: ET.Element | None, key: str) -> str | None:
        """Return the text of a value; None if it is missing."""
        return None if node is None else node.findtext(key)

    def pose(self, node: ET.Element) -> RigidTransform:
        """Return the pose of an element in the link."""
        pose = node.find("pose")
        if pose is None or not (pose.text or "").strip():
            return RigidTransform()
        frame = pose.get("relative_to")
        if frame and frame != self._name:
            self._refuse(f"<pose>: must be relative to the link, got {frame!r}")
        degrees = pose.get("degrees", "false").strip() in ("true", "1")
        turn = pose.get("rotation_format", "euler_rpy")
        if turn == "euler_rpy":
            values = self.numbers("pose", pose.text, 6)
            rpy = np.radians(values[3:]) if degrees else values[3:]
            return RigidTransform(RollPitchYaw(rpy), values[:3])
        if turn != "quat_xyzw" or degrees:
            self._refuse(f"<pose>: unknown rotation_format {turn}")
        values = self.numbers("pose", pose.text, 7)
        wxyz, norm = values[[6, 3, 4, 5]], np.linalg.norm(values[3:])
        if norm < 1e-6:
            self._refuse("<pose>: its quaternion is zero")
        return RigidTransform(Quaternion(wxyz / norm), values[:3])

    def color(self, node: ET.Element) -> Color | None:
        """Return the colour of a visual; None: the mesh's own."""
        text = node.findtext("material/diffuse")
        if text is None and node.find("material/script") is not None:
            self.warnings.append("a material's script is not read: it has no colour")
        # The fourth number, opacity, has a default.
        return self._rgb("diffuse", text, (3, 4)) if text else None

    def contact(self, node: ET.Element) -> ET.Element | None:
        """Return Drake's contact properties, or None."""
        return node.find(PROXIMITY)

    def _rgb(self, key: str, text: str, counts: tuple[int, ...]) -> Color:
        count = len(text.split())
        values = self.numbers(key, text, count if count in counts else counts[-1])
        if not np.all((values >= 0.0) & (values <= 1.0)):
            self._refuse(f"{key}: must be 0 .. 1 each, got {text!r}")
        return (values[0], values[1], values[2])

    def mass(self, inertial: ET.Element) -> str | None:
        """Return the text of the mass; None if it is missing."""
        return inertial.findtext("mass")

    def numbers(self, key: str, text: str | None, count: int = 1) -> Vector:
        """Return the numbers in a text.

        Raises:
            ScenarioError: If the text is not `count` finite numbers.
        """
        try:
            values = np.array([float(word) for word in (text or "").split()])
        except ValueError:
            values = np.array([])
        if values.shape != (count,) or not np.all(np.isfinite(values)):
            needed = "a finite number" if count == 1 else f"{count} finite numbers"
            self._refuse(f"{key}: needs {needed}, got {text!r}")
        return values

    def geometry(self, node: ET.Element) -> Geometry:
        """Return a visual or collision geometry."""
        shapes = node.findall("geometry/*")
        if len(shapes) != 1:
            self._refuse(f"<{node.tag}>: needs one geometry, got {len(shapes)}")
        return Geometry(
            self.shape(shapes[0]),
            self.pose(node),
            self.color(node),
            self.contact(node),
            ode_friction(node, self.path),
        )

    def shape(self, node: ET.Element) -> Shape | MeshFile:
        """Return the shape of a geometry."""

        def size(key: str, count: int = 1) -> Vector:
            values = self.numbers(key, self.text(node, key), count)
            if not np.all(values > 0.0):
                problem = f"must be greater than 0, got {values.tolist()}"
                self._refuse(f"<{node.tag}> {key}: {problem}")
            return values

        match node.tag:
            case "box":
                return Box(size("size", 3).tolist())
            case "cylinder":
                return Cylinder(float(size("radius")[0]), float(size("length")[0]))
            case "sphere":
                return Sphere(float(size("radius")[0]))
            case "mesh":
                if node.find("submesh") is not None:
                    self._refuse("<submesh>: export the part as a mesh of its own")
                text = (self.text(node, "scale") or "").strip() or "1 1 1"
                scale = self.numbers("scale", text, 1 if len(text.split()) == 1 else 3)
                if not np.all(scale):
                    self._refuse(f"<mesh> scale: must not be 0, got {text!r}")
                uri = (self.text(node, self.mesh) or "").strip()
                file = resolved(self.path, uri)
                return MeshFile(file, scale * np.ones(3), self.path)
        allowed = ", ".join(_SHAPES)
        return self._refuse(f"unknown geometry <{node.tag}> (allowed: {allowed})")

    def inertial(self, link: ET.Element) -> tuple[float | None, SpatialInertia | None]:
        """Return a link's mass and spatial inertia; None if missing or invalid."""
        node = link.find("inertial")
        text = None if node is None else self.mass(node)
        if node is None or text is None:
            return None, None
        mass = float(self.numbers("mass", text)[0])
        X_LI = self.pose(node)
        found = [self.text(node.find("inertia"), key) for key in _MOMENTS]
        if not mass > 0.0 or None in found[:3]:
            return (mass if mass > 0.0 else None), None
        moments = [
            float(self.numbers(key, text or "0")[0])
            for key, text in zip(_MOMENTS, found, strict=True)
        ]
        try:
            I_I = RotationalInertia(*moments)
            return mass, SpatialInertia.MakeFromCentralInertia(
                mass, X_LI.translation(), I_I.ReExpress(X_LI.rotation())
            )
        except RuntimeError:  # no physical body has these moments
            return mass, None


class UrdfReader(SdfReader):
    """Reads the elements of a URDF file. Their values are attributes."""

    link, joint, mesh = "link", "joint", "filename"

    def text(self, node: ET.Element | None, key: str) -> str | None:
        """Return the text of a value; None if it is missing."""
        return None if node is None else node.get(key)

    def pose(self, node: ET.Element) -> RigidTransform:
        """Return the pose of an element in the link."""
        origin = node.find("origin")
        xyz, rpy = (
            self.numbers(key, self.text(origin, key) or "0 0 0", 3)
            for key in ("xyz", "rpy")
        )
        return RigidTransform(RollPitchYaw(rpy), xyz)

    def color(self, node: ET.Element) -> Color | None:
        """Return the colour of a visual; None: the mesh's own."""
        material = node.find("material")
        if material is None:
            return None
        name = material.get("name")
        # As in Drake, a material's name has the same meaning in the whole file.
        same = (m for m in self.root.iter("material") if name and m.get("name") == name)
        for candidate in (material, *same):
            rgba = self.text(candidate.find("color"), "rgba")
            if rgba is not None:
                return self._rgb("rgba", rgba, (4,))
        self.warnings.append(f"material {name!r} has no colour in this file")
        return None

    def contact(self, node: ET.Element) -> ET.Element | None:
        """Return Drake's contact properties, or None."""
        contact = copy.deepcopy(node.find(PROXIMITY))
        for child in () if contact is None else contact:
            child.text = child.attrib.pop("value", None)  # as in an SDF
        return contact

    def mass(self, inertial: ET.Element) -> str | None:
        """Return the text of the mass; None if it is missing."""
        return self.text(inertial.find("mass"), "value")


def resolved(path: Path, uri: str) -> Path:
    """Return the file that a URI in a file names: relative, absolute or in a package.

    A package is ours, or a folder above the file whose package.xml has that name, or a
    folder of that name in one of the folders above. Unlike in Drake, escapes such as
    `%20` for a space are allowed.

    Raises:
        ScenarioError: If there is no such file.
    """
    scheme, colon, rest = uri.partition("://")
    name, _, inside = rest.partition("/")
    where = ""
    if not colon:
        candidates = [path.parent / uri, path.parent / unquote(uri)]
    elif (scheme, name) == ("package", "drake_srg"):
        candidates = [models_path() / inside]
    elif scheme == "file":
        candidates = [Path(rest), Path(unquote(rest))]
    else:  # package:// and Gazebo's model://
        above = path.resolve().parents
        candidates = [folder / name / inside for folder in above]
        candidates += [f / inside for f in above if _package_name(f) == name]
        tried = ", ".join(str(folder / name) for folder in above[:4])
        where = f": no package.xml above the file names {name!r}, and looked in {tried}"
    for candidate in candidates:
        with contextlib.suppress(ValueError):  # a null character
            if candidate.is_file():
                return candidate
    raise ScenarioError(f"{path}: its mesh {uri!r} does not exist{where}")


def _package_name(folder: Path) -> str | None:
    """Return the name in a folder's package.xml, or None."""
    try:
        return ET.parse(folder / "package.xml").getroot().findtext("name")
    except (OSError, ET.ParseError):
        return None
