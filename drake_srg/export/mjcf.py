"""Writes a model as MJCF, MuJoCo's format."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np
from pydrake.geometry import Box, Cylinder, Sphere
from pydrake.math import RigidTransform

from drake_srg.export.meshes import FOLDER, Meshes
from drake_srg.export.model import WORLD, Geometry, Joint, Link, Model, add, to_text
from drake_srg.export.wires import Wires, add_wire_sites, add_wires

_KINDS = {"revolute": "hinge", "prismatic": "slide"}
_TIME_STEP = 0.002  # s
# MuJoCo's constraints yield in proportion to the acceleration that a force would cause.
# Its defaults let the wire turn the light finger links 0.4 rad beyond their limits:
# time constant and damping, as stiff as the step allows, and share held, 0 .. 1.
_STIFF, _HARD = (2.0 * _TIME_STEP, 1.0), (0.99, 0.999, 0.001)


def to_mjcf(model: Model, meshes: Meshes, wires: Wires | None = None) -> str:
    """Return a model as MJCF.

    Links without a joint are fixed where they are, unless they float.

    Args:
        model: The model.
        meshes: Receives its mesh files.
        wires: The wires of its gripper, if it has some.
    """
    return _Writer(model, meshes, wires).write()


class _Writer:
    def __init__(self, model: Model, meshes: Meshes, wires: Wires | None) -> None:
        self._model, self._meshes, self._wires = model, meshes, wires
        self._links = {link.name: link for link in model.links}
        self._start: list[float] = []  # positions, in MuJoCo's order
        self._root = root = ET.Element("mujoco", model=model.name)
        add(root, "compiler", angle="radian", meshdir=FOLDER, autolimits="true")
        add(root, "option", timestep=_TIME_STEP, integrator="implicitfast")
        defaults = add(root, "default")
        add(defaults, "joint", solreflimit=_STIFF, solimplimit=_HARD)
        add(defaults, "equality", solref=_STIFF, solimp=_HARD)
        seen = add(defaults, "default", class_="visual")
        add(seen, "geom", group="2", contype="0", conaffinity="0", density="0")
        touched = add(defaults, "default", class_="collision")
        add(touched, "geom", group="3", solref=_STIFF, solimp=_HARD)
        self._assets = add(root, "asset")
        self._known: set[tuple[str, bool]] = set()

    def write(self) -> str:
        model, root = self._model, self._root
        world = add(root, "worldbody")
        for link in model.roots:
            self._add_body(world, link, None)
        for joint in model.joints:
            if joint.parent == WORLD:
                self._add_body(world, self._links[joint.child], joint)
        if model.apart:
            contact = add(root, "contact")
            for a, b in model.apart:
                add(contact, "exclude", body1=a, body2=b)
        self._add_equalities()
        if self._wires is not None:
            add_wires(root, self._wires)
        self._add_actuators()
        if self._start:
            add(add(root, "keyframe"), "key", name="start", qpos=self._start)
        for element in list(root):
            if element.tag in ("asset", "equality", "actuator") and not len(element):
                root.remove(element)
        return to_text(root)

    def _add_body(self, parent: ET.Element, link: Link, joint: Joint | None) -> None:
        X_PL = link.X_WL if joint is None else joint.X_PC
        body = add(parent, "body", name=link.name, **_pose(X_PL))
        if joint is None and link.free:
            add(body, "freejoint", name=f"{link.name}_free")
            wxyz = X_PL.rotation().ToQuaternion().wxyz()
            self._start += [*X_PL.translation(), *wxyz]
        elif joint is not None and joint.kind in _KINDS:
            self._add_joint(body, joint)
        if link.mass > 0.0:
            moments = link.I_C[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
            add(body, "inertial", pos=link.p_LC, mass=link.mass, fullinertia=moments)
        for geometry in link.geometries:
            self._add_geometry(body, geometry, f"{link.name}_{geometry.name}")
        for loop in self._model.loops:
            for i in (0, 1):
                if loop.links[i] == link.name:
                    add(body, "site", name=f"{loop.name}_{i + 1}", pos=loop.points[i])
        if self._wires is not None:
            self._start += add_wire_sites(body, link.name, self._wires)
        for other in self._model.joints:
            if other.parent == link.name:
                self._add_body(body, self._links[other.child], other)

    def _add_joint(self, body: ET.Element, joint: Joint) -> None:
        limits = None
        if math.isfinite(joint.lower) or math.isfinite(joint.upper):
            limits = np.clip([joint.lower, joint.upper], -1e3, 1e3)
        spring = self._wires.springs.get(joint.name) if self._wires else None
        stiffness, rest = spring or (None, None)
        add(
            body,
            "joint",
            name=joint.name,
            type=_KINDS[joint.kind],
            pos=joint.X_CJ.translation(),
            axis=joint.X_CJ.rotation() @ joint.axis,
            range=limits,
            damping=joint.damping,
            armature=joint.armature,
            stiffness=stiffness,
            springref=rest,
        )
        self._start.append(joint.start)

    def _add_geometry(self, body: ET.Element, geometry: Geometry, name: str) -> None:
        visual = geometry.color is not None
        shape = geometry.shape
        values: dict[str, object]
        match shape:
            case Box():
                values = {"type": "box", "size": 0.5 * np.array(shape.size())}
            case Cylinder():
                half = [shape.radius(), 0.5 * shape.length()]
                values = {"type": "cylinder", "size": half}
            case Sphere():
                values = {"type": "sphere", "size": shape.radius()}
            case _:
                values = {"type": "mesh", "mesh": self._mesh(geometry, name)}
        if visual:
            values |= {"class_": "visual", "rgba": geometry.color}
        else:
            # Torsion and rolling as by default.
            friction = [geometry.friction, 0.005, 0.0001]
            values |= {"class_": "collision", "name": name, "friction": friction}
        add(body, "geom", **values, **_pose(geometry.X_LG))

    def _mesh(self, geometry: Geometry, name: str) -> str:
        """Return the name of a geometry's mesh, an asset."""
        file = self._meshes.file(geometry.shape, name)
        assert file is not None
        visual = geometry.color is not None
        scaled = bool(np.any(file.scale != 1.0))
        asset = f"{file.name}_{'_'.join(f'{s:g}' for s in file.scale)}"
        asset = asset if scaled else file.name
        asset += "_visual" if visual else ""
        if (asset, visual) not in self._known:
            self._known.add((asset, visual))
            add(
                self._assets,
                "mesh",
                name=asset,
                file=f"{file.name}.obj",
                scale=file.scale if scaled else None,
                # What is only seen may be open or flat.
                inertia="shell" if visual else None,
            )
        return asset

    def _add_equalities(self) -> None:
        equality = add(self._root, "equality")
        for joint in self._model.joints:
            if (mimic := joint.mimic) is not None:
                add(
                    equality,
                    "joint",
                    joint1=joint.name,
                    joint2=mimic.joint,
                    polycoef=[mimic.offset, mimic.multiplier, 0, 0, 0],
                )
        for loop in self._model.loops:
            ends = {f"site{i}": f"{loop.name}_{i}" for i in (1, 2)}
            add(equality, "connect", name=loop.name, **ends)

    def _add_actuators(self) -> None:
        actuators = self._root.find("actuator")
        if actuators is None:
            actuators = add(self._root, "actuator")
        for joint in self._model.joints:
            if joint.effort <= 0.0 or (
                self._wires and joint.name in self._wires.springs
            ):
                continue
            limits = None
            if math.isfinite(joint.effort):
                limits = [-joint.effort, joint.effort]
            values = {"name": joint.name, "joint": joint.name}
            if joint.gains is not None:
                kp, kv = joint.gains
                add(actuators, "position", **values, kp=kp, kv=kv, forcerange=limits)
            else:
                add(actuators, "motor", **values, ctrlrange=limits)


def _pose(X: RigidTransform) -> dict[str, object]:
    """Return a pose as attributes."""
    wxyz = X.rotation().ToQuaternion().wxyz()
    return {"pos": X.translation(), "quat": wxyz}
