"""Models as URDF."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np
from pydrake.geometry import Box, Cylinder, Shape, Sphere
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.common.exceptions import ScenarioError
from drake_srg.export.model import (
    WORLD,
    Geometry,
    Joint,
    Link,
    Meshes,
    Model,
    add,
    to_text,
)

# URDF requires limits of effort and velocity, and takes a missing position limit for 0.
_NO_LIMIT = 1e9


def to_urdf(model: Model, meshes: Meshes) -> str:
    """Return a model as URDF, with Drake's elements where URDF has none.

    Args:
        model: The model.
        meshes: Receives its mesh files.

    Raises:
        ScenarioError: If a joint's axis does not pass through its link's origin.
    """
    root = ET.Element("robot", name=model.name)
    root.set("xmlns:drake", "http://drake.mit.edu")
    # With these options, MuJoCo finds the meshes, and does not merge fixed links.
    add(add(root, "mujoco"), "compiler", strippath="false", fusestatic="false")
    # A URDF must be one tree, so several roots need a common parent.
    roots = model.roots
    if len(roots) != 1 or any(joint.parent == WORLD for joint in model.joints):
        add(root, "link", name=WORLD)
    else:
        roots = ()
    for link in model.links:
        _add_link(root, link, meshes)
    for link in roots:
        kind = "floating" if link.free else "fixed"
        element = add(root, "joint", name=f"{link.name}_in_world", type=kind)
        _add_origin(element, link.X_WL)
        add(element, "parent", link=WORLD)
        add(element, "child", link=link.name)
    for joint in model.joints:
        _add_joint(root, joint)
    for joint in model.joints:
        if joint.effort > 0.0:
            _add_transmission(root, joint)
    for loop in model.loops:
        element = add(root, "drake:ball_constraint")
        for letter, name in zip("AB", loop.links, strict=True):
            add(element, f"drake:ball_constraint_body_{letter}", name=name)
        for points, point in zip(("AP", "BQ"), loop.points, strict=True):
            add(element, f"drake:ball_constraint_p_{points}", value=point)
    for a, b in model.apart:
        group = add(root, "drake:collision_filter_group", name=f"{a}_and_{b}")
        add(group, "drake:member", link=a)
        add(group, "drake:member", link=b)
        add(group, "drake:ignored_collision_filter_group", name=f"{a}_and_{b}")
    return to_text(root)


def _add_link(root: ET.Element, link: Link, meshes: Meshes) -> None:
    element = add(root, "link", name=link.name)
    if link.mass > 0.0:
        inertial = add(element, "inertial")
        add(inertial, "origin", xyz=link.p_LC, rpy="0 0 0")
        add(inertial, "mass", value=link.mass)
        pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
        moments = {f"i{'xyz'[i]}{'xyz'[j]}": link.I_C[i, j] for i, j in pairs}
        add(inertial, "inertia", **moments)
    for geometry in link.geometries:
        _add_geometry(element, geometry, f"{link.name}_{geometry.name}", meshes)


def _add_geometry(
    link: ET.Element, geometry: Geometry, name: str, meshes: Meshes
) -> None:
    visual = geometry.color is not None
    element = add(link, "visual" if visual else "collision", name=name)
    _add_origin(element, geometry.X_LG)
    _add_shape(add(element, "geometry"), geometry.shape, name, meshes)
    if visual:
        material = add(element, "material", name=f"{name}_color")
        add(material, "color", rgba=geometry.color)
    else:
        contact = add(element, "drake:proximity_properties")
        for mu in ("drake:mu_dynamic", "drake:mu_static"):
            add(contact, mu, value=geometry.friction)


def _add_shape(parent: ET.Element, shape: Shape, name: str, meshes: Meshes) -> None:
    match shape:
        case Box():
            add(parent, "box", size=shape.size())
        case Cylinder():
            add(parent, "cylinder", radius=shape.radius(), length=shape.length())
        case Sphere():
            add(parent, "sphere", radius=shape.radius())
        case _:
            file = meshes.file(shape, name)
            assert file is not None
            scale = file.scale if np.any(file.scale != 1.0) else None
            mesh = add(parent, "mesh", filename=file.path, scale=scale)
            if file.convex:
                add(mesh, "drake:declare_convex")


def _add_joint(root: ET.Element, joint: Joint) -> None:
    X_CJ = joint.X_CJ
    if joint.kind != "fixed" and np.abs(X_CJ.translation()).max() > 1e-9:
        raise ScenarioError(
            f"joint {joint.name}: URDF needs its axis through the origin of link "
            f"{joint.child} (allowed: --sdf, --mjcf)"
        )
    kind = joint.kind
    if kind == "revolute" and math.isinf(joint.lower) and math.isinf(joint.upper):
        kind = "continuous"
    element = add(root, "joint", name=joint.name, type=kind)
    _add_origin(element, joint.X_PC)
    add(element, "parent", link=joint.parent)
    add(element, "child", link=joint.child)
    if joint.kind == "fixed":
        return
    add(element, "axis", xyz=X_CJ.rotation() @ joint.axis)
    limits = {"effort": joint.effort, "velocity": joint.velocity}
    if kind != "continuous":
        limits = {"lower": joint.lower, "upper": joint.upper, **limits}
    limits = {k: float(np.clip(v, -_NO_LIMIT, _NO_LIMIT)) for k, v in limits.items()}
    if math.isfinite(joint.acceleration):
        limits["drake:acceleration"] = joint.acceleration
    if kind != "continuous" or joint.effort > 0.0:
        add(element, "limit", **limits)
    add(element, "dynamics", damping=joint.damping)
    if joint.mimic is not None:
        mimic = joint.mimic
        values = {"multiplier": mimic.multiplier, "offset": mimic.offset}
        add(element, "mimic", joint=mimic.joint, **values)


def _add_transmission(root: ET.Element, joint: Joint) -> None:
    element = add(root, "transmission", name=f"{joint.name}_transmission")
    add(element, "type").text = "transmission_interface/SimpleTransmission"
    interface = "hardware_interface/EffortJointInterface"
    held = add(element, "joint", name=joint.name)
    add(held, "hardwareInterface").text = interface
    actuator = add(element, "actuator", name=joint.name)
    add(actuator, "hardwareInterface").text = interface
    add(actuator, "mechanicalReduction").text = "1"
    add(actuator, "drake:rotor_inertia", value=joint.rotor_inertia)
    add(actuator, "drake:gear_ratio", value=joint.gear_ratio)
    if joint.gains is not None:
        add(actuator, "drake:controller_gains", p=joint.gains[0], d=joint.gains[1])


def _add_origin(parent: ET.Element, X: RigidTransform) -> None:
    rpy = RollPitchYaw(X.rotation()).vector()
    add(parent, "origin", xyz=X.translation(), rpy=rpy)
