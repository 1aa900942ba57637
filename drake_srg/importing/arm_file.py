"""An arm read from a URDF or SDF file: one chain of joints from a base to a tip.

Drake's parser determines how joints connect links. It gets the file without geometry,
inertia and limits, which are invalid in many public files.
"""

from __future__ import annotations

import copy
import dataclasses as dc
import itertools
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    Joint,
    ModelInstanceIndex,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    SpatialInertia,
    WeldJoint,
)

from drake_srg.common.exceptions import ScenarioError, one_line, suggest
from drake_srg.objects.meshes.convert import (
    MeshReader,
    mesh_inertia,
    total,
    unit_density,
)
from drake_srg.objects.meshes.files import (
    Contents,
    Geometry,
    MeshFile,
    require_trimesh,
)
from drake_srg.objects.meshes.links import SdfReader, open_model
from drake_srg.objects.meshes.sources import SUFFIXES
from drake_srg.objects.sdf import DRAKE
from drake_srg.types import Vector

# Density of links without a mass, as of largely hollow aluminium castings [kg/m³].
DENSITY = 1000.0
# Without an acceleration limit, a joint reaches its top speed in this time [s]. The
# iiwa takes 0.17 to 0.24 s.
TIME_TO_SPEED = 0.25
# Usual names of frames for tools, the preferred ones first.
_FLANGES = ("tool0", "flange", "link_ee", "ee_link", "link_eef")
# Elements that are hidden from Drake's parser.
_UNREAD = (
    *("visual", "collision", "inertial", "limit", "dynamics", "transmission"),
    *("mimic", f"{{{DRAKE}}}mimic", "safety_controller", "calibration"),
    *("gazebo", "plugin", "sensor"),
)
_HUGE = 1e15  # a larger limit counts as no limit
_ALIGNED = 0.99  # cosine of the largest angle between axes that count as parallel


@dc.dataclass(frozen=True, eq=False)
class ArmJoint:
    """A joint of the chain, between a parent link P and its child link C.

    Attributes:
        name: Name of the joint.
        kind: `revolute` or `prismatic`.
        X_PC: Pose of the child in the parent at position 0 [m].
        X_CJ: Pose of the joint's frame in the child [m].
        axis: Axis in the joint's frame, shape (3,).
        lower: Least position; -inf without a limit [rad or m].
        upper: Greatest position; inf without a limit [rad or m].
        velocity: Greatest speed [rad/s or m/s].
        acceleration: Greatest acceleration [rad/s² or m/s²].
        effort: Greatest torque or force [N m or N].
        damping: Viscous damping [N m s/rad or N s/m].
    """

    name: str
    kind: str
    X_PC: RigidTransform
    X_CJ: RigidTransform
    axis: Vector
    lower: float
    upper: float
    velocity: float
    acceleration: float
    effort: float
    damping: float


@dc.dataclass(frozen=True, eq=False)
class ArmLink:
    """A rigid link L: a body of the file, with all bodies that are fixed to it.

    Attributes:
        name: Name of the body that gives L its frame.
        contents: Geometry and inertia of all bodies, in L.
        frames: Poses of the other bodies in L, by name [m].
    """

    name: str
    contents: Contents
    frames: Mapping[str, RigidTransform]


@dc.dataclass(frozen=True, eq=False)
class ArmFile:
    """An arm as its file describes it.

    Attributes:
        path: The file.
        links: The N + 1 links, from the base to the last.
        joints: The N joints between them.
        X_LT: Pose of the flange in the last link [m]; its z points out of the arm.
        warnings: Repairs, assumptions and omissions, in words.
    """

    path: Path
    links: Sequence[ArmLink]
    joints: Sequence[ArmJoint]
    X_LT: RigidTransform
    warnings: Sequence[str]


@dc.dataclass(frozen=True)
class GivenLimits:
    """Limits that replace a file's: none, one for all joints, or one per joint."""

    velocity: Sequence[float] = ()
    acceleration: Sequence[float] = ()
    effort: Sequence[float] = ()


def read_arm(path: Path, tip: str = "", given: GivenLimits | None = None) -> ArmFile:
    """Read the arm of a file.

    Args:
        path: A URDF or SDF file.
        tip: Link or frame that carries the gripper; links beyond it are left out.
            Empty: the end of the chain, if there is only one.
        given: Limits that replace those of the file.

    Raises:
        ScenarioError: If the file holds no arm that can be simulated.
        ImportError: If a mesh needs packages of the extra `import`.
    """
    read = open_model(path)
    tree = _Tree(read)
    chain = tree.chain(tip)
    links = [tree.link(root, chain) for root in chain.roots]
    if not any(link.contents.mass for link in links[1:]):
        tree.refuse("its moving links have neither mass nor geometry (zero inertia)")
    joints = _joints(tree, chain, given or GivenLimits())
    X_LT = _flange(tree, chain, links)
    return ArmFile(path, links, joints, X_LT, list(dict.fromkeys(read.warnings)))


@dc.dataclass(frozen=True, eq=False)
class _Chain:
    """The joints that move, and the links before, between and after them."""

    joints: Sequence[Joint]
    roots: Sequence[RigidBody]
    tip: RigidBody
    named: bool  # whether the tip is a frame made for tools


class _Tree:
    """The bodies and joints of a file, with all joints at 0."""

    def __init__(self, read: SdfReader) -> None:
        self.read = read
        joints = read.root.findall(read.joint)
        self.elements = {node.get("name"): node for node in joints}
        for name, node in self.elements.items():
            if node.get("type") == "floating":  # Drake only warns about it
                self.refuse(f"joint {name}: the base floats (allowed: a fixed joint)")
        self._plant = plant = MultibodyPlant(time_step=0.0)
        root = copy.deepcopy(read.root)
        for parent in list(root.iter()):
            for child in [node for node in parent if node.tag in _UNREAD]:
                parent.remove(child)
        if root.find(".//include") is not None:
            self.refuse("<include>: copy the included model into the file")
        kind = "sdf" if root.tag == "sdf" else "urdf"
        text = ET.tostring(root, encoding="unicode")
        try:
            models = Parser(plant).AddModels(file_contents=text, file_type=kind)
        except RuntimeError as error:
            reason = one_line(error).removeprefix("<literal-string>.")
            raise ScenarioError(f"{read.path}: {reason}") from None
        if len(models) != 1:
            self.refuse(f"must hold one model, got {len(models)}")
        self.above: dict[str, Joint] = {}  # the joint that carries each body
        self.below: dict[str, list[Joint]] = {}
        for joint in map(plant.get_joint, plant.GetJointIndices()):
            child = joint.child_body().name()
            if child in self.above:
                both = f"{self.above[child].name()} and {joint.name()}"
                self.refuse(f"link {child}: {both} close a chain")
            self.above[child] = joint
            self.below.setdefault(joint.parent_body().name(), []).append(joint)
        for node in root.iter():
            tag = str(node.tag).removeprefix(f"{{{DRAKE}}}")
            if tag.endswith("_constraint") or tag == "gearbox":
                self.refuse(f"<{tag}>: closes a chain: an arm is one chain of joints")
        self._weld_base()
        plant.Finalize()
        self.context = plant.CreateDefaultContext()
        plant.SetPositions(self.context, np.zeros(plant.num_positions()))

    def refuse(self, problem: str) -> NoReturn:
        """Raise an error about the file."""
        raise ScenarioError(f"{self.read.path}: {problem}")

    def _weld_base(self) -> None:
        plant = self._plant
        bodies = [plant.get_body(i) for i in plant.GetBodyIndices(_last_model(plant))]
        loose = [body for body in bodies if body.name() not in self.above]
        if not bodies or not self.above:
            self.refuse("has no joints: an arm needs at least one that moves")
        fixed = "world" in self.below
        if not loose and not fixed:
            self.refuse("its joints close a chain: no link is the base")
        if len(loose) + fixed != 1:
            names = ", ".join([*(b.name() for b in loose), *(["world"] * fixed)])
            self.refuse(f"must have one base, got {names}: connect them by joints")
        for body in loose:
            plant.WeldFrames(plant.world_frame(), body.body_frame())

    def chain(self, tip: str) -> _Chain:
        """Return the chain from the base to a tip; "" stands for the only tip."""
        body, named = self._tip(tip)
        joints: list[Joint] = []
        on_the_way, at = [body], body
        while at.name() in self.above:
            joint = self.above[at.name()]
            at = joint.parent_body()
            on_the_way.append(at)
            if isinstance(joint, WeldJoint):
                continue
            if not isinstance(joint, RevoluteJoint | PrismaticJoint):
                self.refuse(
                    f"joint {joint.name()}: {joint.type_name()} cannot be driven "
                    "(allowed: revolute, continuous, prismatic, fixed)"
                )
            if at.name() == "world":
                self.refuse(f"joint {joint.name()}: needs a link as its parent")
            joints.insert(0, joint)
        if not joints:
            self.refuse(f"no joint moves {body.name()!r}: an arm needs at least one")
        base = next(b for b in reversed(on_the_way) if b.name() != "world")
        return _Chain(joints, [base, *(j.child_body() for j in joints)], body, named)

    def _tip(self, name: str) -> tuple[RigidBody, bool]:
        bodies = {body.name(): body for body in self._bodies()}
        if name:
            if name not in bodies:
                self.refuse(f"--tip: unknown link {name!r} {suggest(name, bodies)}")
            return bodies[name], not self._shown(name)
        moved = [j.child_body() for j in self._moving()]
        last = [b for b in moved if not any(self._moving(b.name()))]
        if not last:
            self.refuse("has no joints that move: an arm needs at least one")
        if len(last) > 1:
            ends = ", ".join(body.name() for body in last)
            fork = self._common([body.name() for body in last])
            self.refuse(f"several tips: {ends} (--tip LINK, such as --tip {fork})")
        fixed = [b.name() for b in self._fixed(last[0].name())][1:]
        bare = [b for b in fixed if not self._shown(b)]
        riding = [b for b in fixed if self._shown(b)]
        if riding:
            self.read.warnings.append(
                f"the last link keeps {', '.join(riding)} (--tip LINK leaves out what "
                "is beyond LINK)"
            )
        found = [b for flange in _FLANGES for b in bare if b.endswith(flange)]
        if found or bare:
            return bodies[(found or bare[-1:])[0]], True
        return last[0], False

    def _bodies(self) -> Iterator[RigidBody]:
        for index in self._plant.GetBodyIndices(_last_model(self._plant)):
            yield self._plant.get_body(index)

    def _moving(self, body: str | None = None) -> Iterator[Joint]:
        """Yield the joints that move: all, or those beyond a body."""
        if body is None:
            joints = list(itertools.chain.from_iterable(self.below.values()))
        else:
            joints = self.below.get(body, [])
        for joint in joints:
            if not isinstance(joint, WeldJoint):
                yield joint
            if body is not None:
                yield from self._moving(joint.child_body().name())

    def _common(self, names: Sequence[str]) -> str:
        """Return the last common ancestor of some bodies."""
        paths = []
        for name in names:
            path = [name]
            while path[0] in self.above:
                path.insert(0, self.above[path[0]].parent_body().name())
            paths.append(path)
        shared = [s[0] for s in zip(*paths, strict=False) if len(set(s)) == 1]
        return shared[-1] if shared else names[0]

    def _fixed(self, name: str, end: str = "") -> Iterator[RigidBody]:
        """Yield a body and all bodies fixed to it, but none beyond the body `end`."""
        yield self._plant.GetBodyByName(name, _last_model(self._plant))
        for joint in self.below.get(name, []) if name != end else []:
            if isinstance(joint, WeldJoint):
                yield from self._fixed(joint.child_body().name(), end)

    def _shown(self, name: str) -> bool:
        node = self._element(name)
        return any(node.find(tag) is not None for tag in ("visual", "collision"))

    def _element(self, name: str) -> ET.Element:
        links = self.read.root.findall(self.read.link)
        return next(node for node in links if node.get("name") == name)

    def X_WB(self, body: RigidBody) -> RigidTransform:
        """Return the pose of a body in world with all joints at 0."""
        return body.EvalPoseInWorld(self.context)

    def link(self, root: RigidBody, chain: _Chain) -> ArmLink:
        """Return the link of a body and of all bodies that are fixed to it."""
        warnings, reader = self.read.warnings, MeshReader(self.read.warnings)
        visuals: list[Geometry] = []
        collisions: list[Geometry] = []
        solids: list[SpatialInertia] = []
        frames = {}
        for body in self._fixed(root.name(), chain.tip.name()):
            X_LB = self.X_WB(root).inverse() @ self.X_WB(body)
            if body is not root:
                frames[body.name()] = X_LB
            read = self.read.contents(self._element(body.name()))
            seen = [g for g in read.visuals if not _is_unreadable(g)]
            if lost := [g for g in read.visuals if _is_unreadable(g)]:
                assert isinstance(lost[0].shape, MeshFile)
                warnings.append(
                    f"visuals in {lost[0].shape.path.suffix} are not read (allowed: "
                    f"{', '.join(SUFFIXES)}): collision meshes are shown in their place"
                )
            touched = read.collisions or seen
            M_BBo_B = _inertia(body.name(), read, touched, reader)
            solids.append(M_BBo_B.ReExpress(X_LB.rotation()).Shift(-X_LB.translation()))
            visuals += [_moved(X_LB, g) for g in seen or read.collisions]
            collisions += [_moved(X_LB, g) for g in touched]
        M_LLo_L = total(solids)
        contents = Contents(
            self.read.path, visuals, collisions, M_LLo_L, M_LLo_L.get_mass(), warnings
        )
        return ArmLink(root.name(), contents, frames)


def _last_model(plant: MultibodyPlant) -> ModelInstanceIndex:
    """Return the model instance of the file."""
    return ModelInstanceIndex(plant.num_model_instances() - 1)


def _is_unreadable(geometry: Geometry) -> bool:
    shape = geometry.shape
    return isinstance(shape, MeshFile) and shape.path.suffix.lower() not in SUFFIXES


def _moved(X_LB: RigidTransform, geometry: Geometry) -> Geometry:
    return dc.replace(geometry, X_LG=X_LB @ geometry.X_LG)


def _inertia(
    name: str, read: Contents, touched: Sequence[Geometry], reader: MeshReader
) -> SpatialInertia:
    """Return the spatial inertia of a body about its origin, from file or geometry."""
    if read.inertia is not None:
        return read.inertia
    hull = require_trimesh().convex.convex_hull if touched else None
    solids = []
    for geometry in touched:
        if isinstance(geometry.shape, MeshFile):
            assert hull is not None
            solids.append(mesh_inertia(hull(reader.solid(geometry).vertices)))
        else:
            X_BG, M = geometry.X_LG, unit_density(geometry.shape)
            solids.append(M.ReExpress(X_BG.rotation()).Shift(-X_BG.translation()))
    if not solids:
        if read.mass is None:
            return SpatialInertia.Zero()
        reader.warnings.append(f"{name}: no moments of inertia: took a ball's of 3 cm")
        return SpatialInertia.SolidSphereWithMass(read.mass, 0.03)
    volume = total(solids)
    mass = read.mass
    if mass is None:
        mass = DENSITY * volume.get_mass()
        reader.warnings.append(
            f"{name}: no mass: assumed {mass:.3g} kg ({DENSITY:.0f} kg/m³)"
        )
    else:
        reader.warnings.append(f"{name}: no moments of inertia: took the geometry's")
    return SpatialInertia(mass, volume.get_com(), volume.get_unit_inertia())


def _joints(tree: _Tree, chain: _Chain, given: GivenLimits) -> list[ArmJoint]:
    n = len(chain.joints)
    for key in ("velocity", "acceleration", "effort"):
        values = getattr(given, key)
        if len(values) not in (0, 1, n):
            tree.refuse(f"--{key}: needs one number, or one per joint ({n})")
        if not all(math.isfinite(value) and value > 0.0 for value in values):
            tree.refuse(f"--{key}: must be greater than 0, got {list(values)}")
    return [_joint(tree, chain, i, given) for i in range(n)]


def _joint(tree: _Tree, chain: _Chain, i: int, given: GivenLimits) -> ArmJoint:
    """Return joint i of the chain, with its limits."""
    joint, parent, child = chain.joints[i], chain.roots[i], chain.roots[i + 1]
    name, node, read = joint.name(), tree.elements[joint.name()], tree.read
    if any(str(e.tag).rpartition("}")[2] == "mimic" for e in node.iter()):
        tree.refuse(f"joint {name}: follows another joint (mimic), needs a motor")
    turns = isinstance(joint, RevoluteJoint)
    unit = "rad" if turns else "m"
    # In an SDF, limits and dynamics are inside the axis.
    nodes = [node.find(f"{at}limit") for at in ("", "axis/")]
    limits = next((e for e in nodes if e is not None), None)
    nodes = [node.find(f"{at}dynamics") for at in ("", "axis/")]
    dynamics = next((e for e in nodes if e is not None), None)

    def number(at: ET.Element | None, key: str, default: float = math.nan) -> float:
        text = read.text(at, key)
        return default if text is None else float(read.numbers(key, text)[0])

    def limit(key: str, unit: str) -> float:
        values = getattr(given, key)
        value = values[min(i, len(values) - 1)] if values else number(limits, key)
        if not 0.0 < value < _HUGE:
            problem = f"has no {key} limit in {unit} (--{key} N, or N,N,...)"
            tree.refuse(f"joint {name}: {problem}")
        return float(value)

    velocity = limit("velocity", f"{unit}/s")
    acceleration = number(limits, f"{{{DRAKE}}}acceleration")
    if given.acceleration:
        acceleration = limit("acceleration", f"{unit}/s²")
    elif not 0.0 < acceleration < _HUGE:
        acceleration = velocity / TIME_TO_SPEED
        read.warnings.append(
            f"no acceleration limits: assumed full speed in {TIME_TO_SPEED} s"
        )
    lower, upper = -math.inf, math.inf
    if node.get("type") != "continuous":
        missing = math.inf if read.root.tag == "sdf" else 0.0
        lower = number(limits, "lower", -missing)
        upper = number(limits, "upper", missing)
    if not turns and not (lower > -_HUGE and upper < _HUGE):
        tree.refuse(f"joint {name}: slides, needs lower and upper limits")
    if not lower < upper:
        problem = f"has no room to move: limits {lower:g} .. {upper:g} {unit}"
        tree.refuse(f"joint {name}: {problem}")
    return ArmJoint(
        name,
        "revolute" if turns else "prismatic",
        tree.X_WB(parent).inverse() @ tree.X_WB(child),
        joint.frame_on_child().GetFixedPoseInBodyFrame(),
        np.array(joint.revolute_axis() if turns else joint.translation_axis()),
        lower,
        upper,
        velocity,
        acceleration,
        limit("effort", "N m" if turns else "N"),
        max(0.0, number(dynamics, "damping", 0.0)),
    )


def _flange(tree: _Tree, chain: _Chain, links: Sequence[ArmLink]) -> RigidTransform:
    """Return the pose of the flange in the last link; its z is the last joint's axis.

    A frame for tools keeps its own z if that is parallel to the axis. Otherwise, z
    points away from the previous link. If the tip is a link with geometry, the flange
    is on its outer face.
    """
    last, joint = chain.roots[-1], chain.joints[-1]
    X_LT: RigidTransform = tree.X_WB(last).inverse() @ tree.X_WB(chain.tip)
    if not isinstance(joint, RevoluteJoint):
        return X_LT
    axis_L = joint.frame_on_child().GetFixedPoseInBodyFrame().rotation() @ (
        joint.revolute_axis()
    )
    z, warnings = X_LT.rotation().col(2), tree.read.warnings
    before = _points(links[-2], tree.read)
    if len(before):
        X_LP = tree.X_WB(last).inverse() @ tree.X_WB(chain.roots[-2])
        middle = X_LP @ (0.5 * (before.min(axis=0) + before.max(axis=0)))
        out = float(axis_L @ (X_LT.translation() - middle))
        axis_L = axis_L * (1.0 if out >= 0.0 else -1.0)
    if not chain.named or abs(z @ axis_L) < _ALIGNED:
        turn = RotationMatrix(_shortest_turn(z, axis_L))
        if z @ axis_L < _ALIGNED:
            warnings.append(
                f"{chain.tip.name()}: turned the flange's z to the axis of "
                f"{joint.name()}"
            )
        X_LT = RigidTransform(turn @ X_LT.rotation(), X_LT.translation())
    if not chain.named and links[-1].contents.collisions:
        ahead = _reach(links[-1], tree.read, axis_L) - X_LT.translation() @ axis_L
        if ahead > 0.0:
            warnings.append(
                f"{chain.tip.name()}: put the flange on its outer face, "
                f"{1e3 * ahead:.0f} mm from its origin"
            )
            X_LT = RigidTransform(X_LT.rotation(), X_LT.translation() + ahead * axis_L)
    return X_LT


def _points(link: ArmLink, read: SdfReader) -> Vector:
    """Return points whose bounds enclose a link's collision geometry, (n, 3) [m]."""
    reader, found = MeshReader(read.warnings), [np.zeros((0, 3))]
    for geometry in link.contents.collisions:
        if isinstance(geometry.shape, MeshFile):
            found.append(np.asarray(reader.solid(geometry).vertices))
        else:
            R, p = geometry.X_LG.rotation().matrix(), geometry.X_LG.translation()
            reach = np.array([geometry.shape.half_extent(row) for row in R])
            found.append(np.array([p - reach, p + reach]))
    return np.vstack(found)


def _reach(link: ArmLink, read: SdfReader, axis_L: Vector) -> float:
    """Return how far a link's collision geometry reaches along an axis [m]."""
    reader, reaches = MeshReader(read.warnings), []
    for geometry in link.contents.collisions:
        if isinstance(geometry.shape, MeshFile):
            reaches.append(np.max(reader.solid(geometry).vertices @ axis_L))
        else:
            X_LG = geometry.X_LG
            own = geometry.shape.half_extent(X_LG.rotation().inverse() @ axis_L)
            reaches.append(X_LG.translation() @ axis_L + own)
    return float(max(reaches))


def _shortest_turn(start: Vector, end: Vector) -> Vector:
    """Return the smallest rotation of one unit vector to another, shape (3, 3)."""
    cosine = float(start @ end)
    if cosine < -_ALIGNED:  # half a turn about any axis across
        across = np.cross(start, np.eye(3)[int(np.argmin(np.abs(start)))])
        across /= np.linalg.norm(across)
        half = 2.0 * np.outer(across, across) - np.eye(3)
        return _shortest_turn(half @ start, end) @ half
    v = np.cross(start, end)
    K = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.asarray(np.eye(3) + K + K @ K / (1.0 + cosine))
