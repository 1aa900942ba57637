"""Models as SDF."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np
from pydrake.geometry import Box, Cylinder, Shape, Sphere
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.export.model import (
    WORLD,
    Geometry,
    Joint,
    Link,
    Meshes,
    Model,
    add,
    numbers,
    to_text,
)


def to_sdf(model: Model, meshes: Meshes) -> str:
    """Return a model as SDF 1.11, with Drake's elements where SDF has none.

    Args:
        model: The model.
        meshes: Receives its mesh files.
    """
    document = ET.Element("sdf", version="1.11")
    document.set("xmlns:drake", "http://drake.mit.edu")
    root = add(document, "model", name=model.name)
    placed = {joint.child: joint for joint in model.joints}
    for link in model.links:
        _add_link(root, link, placed.get(link.name), meshes)
    for joint in model.joints:
        _add_joint(root, joint)
    for loop in model.loops:
        element = add(root, "drake:ball_constraint", name=loop.name)
        for letter, name in zip("AB", loop.links, strict=True):
            _add_text(element, f"drake:ball_constraint_body_{letter}", name)
        for points, point in zip(("AP", "BQ"), loop.points, strict=True):
            _add_text(element, f"drake:ball_constraint_p_{points}", point)
    for a, b in model.apart:
        group = add(root, "drake:collision_filter_group", name=f"{a}_and_{b}")
        _add_text(group, "drake:member", a)
        _add_text(group, "drake:member", b)
        _add_text(group, "drake:ignored_collision_filter_group", f"{a}_and_{b}")
    return to_text(document)


def _add_link(
    root: ET.Element, link: Link, joint: Joint | None, meshes: Meshes
) -> None:
    element = add(root, "link", name=link.name)
    if joint is not None:
        # In SDF, the pose of a link is that at its joint's zero position.
        parent = None if joint.parent == WORLD else joint.parent
        _add_pose(element, joint.X_PC, relative_to=parent)
    else:
        _add_pose(element, link.X_WL)
    if link.mass > 0.0:
        inertial = add(element, "inertial")
        _add_pose(inertial, RigidTransform(link.p_LC))
        _add_text(inertial, "mass", link.mass)
        inertia = add(inertial, "inertia")
        for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
            _add_text(inertia, f"i{'xyz'[i]}{'xyz'[j]}", link.I_C[i, j])
    for geometry in link.geometries:
        _add_geometry(element, geometry, f"{link.name}_{geometry.name}", meshes)


def _add_geometry(
    link: ET.Element, geometry: Geometry, name: str, meshes: Meshes
) -> None:
    visual = geometry.color is not None
    element = add(link, "visual" if visual else "collision", name=geometry.name)
    _add_pose(element, geometry.X_LG)
    _add_shape(add(element, "geometry"), geometry.shape, name, meshes)
    if visual:
        material = add(element, "material")
        _add_text(material, "ambient", geometry.color)
        _add_text(material, "diffuse", geometry.color)
        return
    ode = add(add(add(element, "surface"), "friction"), "ode")
    contact = add(element, "drake:proximity_properties")
    for parent, tags in (
        (ode, ("mu", "mu2")),
        (contact, ("drake:mu_dynamic", "drake:mu_static")),
    ):
        for tag in tags:
            _add_text(parent, tag, geometry.friction)


def _add_shape(parent: ET.Element, shape: Shape, name: str, meshes: Meshes) -> None:
    match shape:
        case Box():
            _add_text(add(parent, "box"), "size", shape.size())
        case Cylinder():
            cylinder = add(parent, "cylinder")
            _add_text(cylinder, "radius", shape.radius())
            _add_text(cylinder, "length", shape.length())
        case Sphere():
            _add_text(add(parent, "sphere"), "radius", shape.radius())
        case _:
            file = meshes.file(shape, name)
            assert file is not None
            mesh = add(parent, "mesh")
            _add_text(mesh, "uri", file.path)
            if np.any(file.scale != 1.0):
                _add_text(mesh, "scale", file.scale)
            if file.convex:
                add(mesh, "drake:declare_convex")


def _add_joint(root: ET.Element, joint: Joint) -> None:
    element = add(root, "joint", name=joint.name, type=joint.kind)
    _add_text(element, "parent", joint.parent)
    _add_text(element, "child", joint.child)
    if joint.kind == "fixed":
        return
    _add_pose(element, joint.X_CJ)
    axis = add(element, "axis")
    _add_text(axis, "xyz", joint.axis)
    limits = {
        "lower": joint.lower,
        "upper": joint.upper,
        "effort": joint.effort,
        "velocity": joint.velocity,
        "drake:acceleration": joint.acceleration,
    }
    limit = add(axis, "limit")
    for tag, value in limits.items():
        if math.isfinite(value):
            _add_text(limit, tag, value)
    _add_text(add(axis, "dynamics"), "damping", joint.damping)
    if joint.effort > 0.0:
        _add_text(element, "drake:rotor_inertia", joint.rotor_inertia)
        _add_text(element, "drake:gear_ratio", joint.gear_ratio)
    if joint.gains is not None:
        p, d = joint.gains
        add(element, "drake:controller_gains", p=p, d=d)
    if joint.mimic is not None:
        mimic = joint.mimic
        values = {"multiplier": mimic.multiplier, "offset": mimic.offset}
        add(element, "drake:mimic", joint=mimic.joint, **values)
        standard = add(axis, "mimic", joint=mimic.joint)
        for tag, value in (values | {"reference": 0.0}).items():
            _add_text(standard, tag, value)


def _add_pose(
    parent: ET.Element, X: RigidTransform, relative_to: str | None = None
) -> None:
    rpy = RollPitchYaw(X.rotation()).vector()
    pose = add(parent, "pose", relative_to=relative_to)
    pose.text = numbers([*X.translation(), *rpy])


def _add_text(parent: ET.Element, tag: str, value: object) -> None:
    add(parent, tag).text = numbers(value)
