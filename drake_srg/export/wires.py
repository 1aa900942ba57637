"""The wires of the SRG as MuJoCo's tendons.

MuJoCo adds up the lengths of a tendon's branches. Here each branch is a straight line
between a point on one side of a hinge and a point on the other side, and a branch at
the spool. The points are chosen so that the lengths change with the joint angles as
the wire's travel does (`drake_srg.gripper.moment_arms`). They are not where the wire
runs in the hardware.

MuJoCo's tendon is a spring that pulls when it is longer than at rest, as the wire does.
The motor moves a slide instead of a spool: 1 m along it takes in 1 m of each wire.
"""

from __future__ import annotations

import dataclasses as dc
import xml.etree.ElementTree as ET

import numpy as np

from drake_srg.export.model import Joint, Model, add
from drake_srg.gripper.driver import GripperDriver
from drake_srg.gripper.moment_arms import base_moment_arm, tip_moment_arm
from drake_srg.gripper.tendon import TendonDriveConfig
from drake_srg.types import Vector

# Distances of the two points from the hinge [m], and the angle from the link's point to
# the parent's at joint angle 0 [rad]. tools/fit_wire_branches.py finds them; the moment
# arms are within 0.3 % (base) and 0.2 % (tip) of the wire's from 0 to 1.94 rad.
_BASE = ((0.01330432, 0.02188755, 2.334122),)
_TIP = (
    (0.00499039, 0.03999955, -0.303315),
    (0.00582687, 0.00872223, 2.726326),
    (0.00531885, 0.03999962, 1.861658),
)
_SPOOL = 0.02  # length of the branch at the spool, with nothing taken in [m]
_SLIDE_MASS = 1e-6  # MuJoCo needs some [kg]


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
        """Return how fast the length decreases with the joint angle [m]."""
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
        springs: Of each joint: stiffness [N m/rad], and angle without torque [rad].
    """

    drive: TendonDriveConfig
    palm: str
    fingers: tuple[tuple[Branch, ...], ...]
    springs: dict[str, tuple[float, float]]


def find_wires(model: Model, driver: GripperDriver | None, prefix: str) -> Wires | None:
    """Return the wires of a model's gripper; None if it has none.

    Args:
        model: The model.
        driver: Of the gripper.
        prefix: What precedes the names of the gripper's joints.
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
    """Append a link's ends of branches; return the positions of joints added."""
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
