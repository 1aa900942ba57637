"""MJCF, MuJoCo's format: models, and the SRG's wires as tendons.

MuJoCo adds up the lengths of a tendon's branches. Here, one branch is at the spool, and
each other branch is a straight line across a hinge, between points on the two links.
The points are chosen so that the total length changes with the joint angles like the
wire's travel (`drake_srg.gripper.tendon`). The real wire does not run through them.

MuJoCo's tendon, like the wire, is a spring that only pulls. The motor moves a slide
instead of a spool: 1 m of its travel takes in 1 m of each wire.
"""

from __future__ import annotations

import dataclasses as dc
import math
import xml.etree.ElementTree as ET

import numpy as np
from pydrake.geometry import Box, Cylinder, Sphere
from pydrake.math import RigidTransform

from drake_srg.export.model import (
    FOLDER,
    WORLD,
    Geometry,
    Joint,
    Link,
    Meshes,
    Model,
    add,
    to_text,
)
from drake_srg.gripper.driver import GripperDriver
from drake_srg.gripper.tendon import TendonDriveConfig, base_moment_arm, tip_moment_arm
from drake_srg.types import Vector

# For each branch, the distances of its points on the parent and on the child from the
# hinge [m], and the angle from the child's point to the parent's at joint angle 0
# [rad], found by tools/fit_wire_branches.py. From 0 to 1.94 rad, the moment arms are
# within 0.3 % (base) and 0.2 % (tip) of the wire's.
_BASE = ((0.01330432, 0.02188755, 2.334122),)
_TIP = (
    (0.00499039, 0.03999955, -0.303315),
    (0.00582687, 0.00872223, 2.726326),
    (0.00531885, 0.03999962, 1.861658),
)
_SPOOL = 0.02  # length of the branch at the spool, with nothing taken in [m]
_SLIDE_MASS = 1e-6  # not 0, which MuJoCo does not allow [kg]


@dc.dataclass(frozen=True)
class Branch:
    """A straight piece of wire across a hinge.

    Attributes:
        joint: The hinge.
        parent: Distance of the point on the parent from the hinge [m].
        child: Distance of the point on the child [m].
        angle: From the child's point to the parent's, at joint angle 0 [rad].
    """

    joint: Joint
    parent: float
    child: float
    angle: float

    def length(self, position: float) -> float:
        """Return the length at a joint angle [rad]."""
        a, b = self.parent, self.child
        return float(np.sqrt(a**2 + b**2 - 2 * a * b * np.cos(self.angle - position)))

    def moment_arm(self, position: float) -> float:
        """Return the moment arm: decrease of the length per joint angle [m/rad]."""
        product = self.parent * self.child * np.sin(self.angle - position)
        return float(product / self.length(position))

    @property
    def p_P(self) -> Vector:
        """The point on the parent [m], shape (3,)."""
        return np.array(self.joint.X_PJ @ _polar(self.parent, self.angle))

    @property
    def p_C(self) -> Vector:
        """The point on the child [m], shape (3,)."""
        return np.array(self.joint.X_CJ @ _polar(self.child, 0.0))


def _polar(radius: float, angle: float) -> Vector:
    return radius * np.array([np.cos(angle), np.sin(angle), 0.0])


@dc.dataclass(frozen=True)
class Wires:
    """The wires of a gripper in a model.

    Attributes:
        drive: Motor, wires and springs.
        palm: The link that carries the motor.
        fingers: The branches of each wire.
        springs: Stiffness [N m/rad] and torque-free angle [rad] of each joint's spring.
    """

    drive: TendonDriveConfig
    palm: str
    fingers: tuple[tuple[Branch, ...], ...]
    springs: dict[str, tuple[float, float]]


def find_wires(model: Model, driver: GripperDriver | None, prefix: str) -> Wires | None:
    """Return the wires of a model's gripper; None if it has none.

    Args:
        model: The model.
        driver: Driver of the gripper.
        prefix: Prefix of the names of the gripper's joints.
    """
    names = [] if driver is None else [f"{prefix}{n}" for n in driver.joint_names]
    known = {joint.name for joint in model.joints}
    if driver is None or driver.wire_motor is None or not known.issuperset(names):
        return None
    drive = driver.wire_motor.drive
    joints = [model.joint(name) for name in names]
    branches: list[tuple[Branch, ...]] = []
    springs = {}
    for base, tip in zip(joints[:2], joints[2:], strict=True):
        branches.append(
            tuple(
                Branch(joint, *numbers)
                for joint, table in ((base, _BASE), (tip, _TIP))
                for numbers in table
            )
        )
        for joint, spring in ((base, drive.base_spring), (tip, drive.tip_spring)):
            rest = -spring.preload / spring.stiffness if spring.stiffness > 0 else 0.0
            springs[joint.name] = (spring.stiffness, rest)
    return Wires(drive, joints[0].parent, tuple(branches), springs)


def add_wire_sites(body: ET.Element, link: str, wires: Wires) -> list[float]:
    """Append a link's ends of branches; return the start positions of added joints."""
    for finger, branches in enumerate(wires.fingers):
        for i, branch in enumerate(branches):
            for side, holder, point in (
                ("parent", branch.joint.parent, branch.p_P),
                ("child", branch.joint.child, branch.p_C),
            ):
                if holder == link:
                    add(body, "site", name=_site(finger, i, side), pos=point)
    if link != wires.palm:
        return []
    drive, radius = wires.drive, wires.drive.spool_radius
    add(body, "site", name="wire_outlet")
    slide = add(body, "body", name="wire_slide", pos=[-_SPOOL, 0, 0], gravcomp="1")
    add(
        slide,
        "joint",
        name="wire_slide",
        type="slide",
        axis="-1 0 0",
        armature=drive.reflected_inertia / radius**2,
        damping=drive.motor_damping / radius**2,
    )
    moments = [1e-3 * _SLIDE_MASS] * 3
    add(slide, "inertial", pos="0 0 0", mass=_SLIDE_MASS, diaginertia=moments)
    add(slide, "site", name="wire_slide")
    return [0.0]


def add_wires(root: ET.Element, wires: Wires) -> None:
    """Append tendons and the motor to an MJCF document."""
    drive = wires.drive
    tendons = add(root, "tendon")
    for finger, branches in enumerate(wires.fingers):
        length = _SPOOL + sum(branch.length(0.0) for branch in branches)
        tendon = add(
            tendons,
            "spatial",
            name=("left_wire", "right_wire")[finger],
            springlength=[0.0, length],
            stiffness=drive.wire_stiffness,
            damping=drive.wire_damping,
            width="0.0004",
        )
        add(tendon, "site", site="wire_slide")
        add(tendon, "site", site="wire_outlet")
        for i in range(len(branches)):
            add(tendon, "pulley", divisor="1")
            add(tendon, "site", site=_site(finger, i, "parent"))
            add(tendon, "site", site=_site(finger, i, "child"))
    add(
        add(root, "actuator"),
        "motor",
        name="wire_motor",
        joint="wire_slide",
        gear=drive.full_torque / drive.spool_radius,
        ctrlrange="-1 1",
    )


def _site(finger: int, branch: int, side: str) -> str:
    return f"wire_{('left', 'right')[finger]}_{branch}_{side}"


def moment_arm_error(wires: Wires) -> float:
    """Return the largest relative error of the moment arms, within the limits."""
    errors = []
    for branches in wires.fingers:
        joints = list(dict.fromkeys(branch.joint.name for branch in branches))
        for name, true_arm in zip(
            joints, (base_moment_arm, tip_moment_arm), strict=True
        ):
            mine = [branch for branch in branches if branch.joint.name == name]
            joint = mine[0].joint
            for angle in np.linspace(joint.lower, joint.upper, 50):
                arm = sum(branch.moment_arm(angle) for branch in mine)
                errors.append(abs(arm / true_arm(angle) - 1.0))
    return max(errors)


_KINDS = {"revolute": "hinge", "prismatic": "slide"}
# The options against slip that MuJoCo's documentation recommends: elliptic cones,
# friction 100 times as stiff as contact, and extra passes of the solver (noslip). At
# the default tolerance of 1e-6, these passes would stop too early, and objects creep.
# With steps of 1 ms, some grasps of `experiments/engines.py` slip; with 2 ms, thin
# objects are lost.
_OPTIONS: dict[str, object] = {
    "timestep": 0.0005,  # s
    "integrator": "implicitfast",
    "cone": "elliptic",
    "impratio": 100,
    "noslip_iterations": 50,
    "noslip_tolerance": 1e-12,
}
# Parameters of constraints: solref (time constant [s] and damping ratio) and solimp.
# MuJoCo's constraints yield in proportion to the acceleration that a force would cause.
# With its defaults, the wire turns the light finger links 0.4 rad beyond their limits.
_STIFF, _HARD = (0.004, 1.0), (0.99, 0.999, 0.001)
# MuJoCo's contacts are points. A soft material, such as a pad's (2 MPa), makes contact
# over an area, and its friction resists twisting. Its lever is that of an evenly
# pressed disc as wide as a pad, 30 mm: two thirds of the radius. Greatest modulus of
# soft materials [Pa], and the lever [m].
_SOFT, _ARM = 1e7, 2.0 / 3.0 * 0.015


def to_mjcf(model: Model, meshes: Meshes, wires: Wires | None = None) -> str:
    """Return a model as MJCF.

    Links without a joint are fixed in world, unless they float.

    Args:
        model: The model.
        meshes: Receives its mesh files.
        wires: The wires of its gripper, if it has wires.
    """
    return _Writer(model, meshes, wires).write()


class _Writer:
    def __init__(self, model: Model, meshes: Meshes, wires: Wires | None) -> None:
        self._model, self._meshes, self._wires = model, meshes, wires
        self._links = {link.name: link for link in model.links}
        self._start: list[float] = []  # positions, in MuJoCo's order
        self._root = root = ET.Element("mujoco", model=model.name)
        add(root, "compiler", angle="radian", meshdir=FOLDER, autolimits="true")
        add(root, "option", **_OPTIONS)
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
            assert geometry.friction is not None
            soft = geometry.modulus < _SOFT
            # Others keep MuJoCo's defaults of torsion and rolling.
            torsion = geometry.friction * _ARM if soft else 0.005
            friction = [geometry.friction, torsion, 0.0001]
            values |= {"class_": "collision", "name": name, "friction": friction}
            values |= {"condim": 4} if soft else {}
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
                # Visual meshes may be open or flat, so they may have no volume.
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
    """Return a pose as XML attributes."""
    wxyz = X.rotation().ToQuaternion().wxyz()
    return {"pos": X.translation(), "quat": wxyz}
