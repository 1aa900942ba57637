"""Models of a finalized plant for export.

Their constraints come from their files, because pydrake cannot read them from a plant.
"""

from __future__ import annotations

import dataclasses as dc
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from pydrake.geometry import GeometryId, Role, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint as DrakeJoint
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody

from drake_srg.common.exceptions import ScenarioError
from drake_srg.export.model import WORLD, Geometry, Joint, Link, Loop, Mimic, Model
from drake_srg.objects.meshes.links import read_xml
from drake_srg.objects.sdf import DRAKE
from drake_srg.scenario import Scenario
from drake_srg.station.plant import model_files

_BALL = f"{{{DRAKE}}}ball_constraint"


@dc.dataclass(frozen=True)
class Constraints:
    """Constraints of a model.

    Attributes:
        mimics: Mimic constraints, by the name of the following joint.
        loops: Pins that close its loops.
    """

    mimics: Mapping[str, Mimic] = dc.field(default_factory=dict)
    loops: tuple[Loop, ...] = ()


def read_constraints(scenario: Scenario) -> dict[str, Constraints]:
    """Return the constraints of a scenario's models, by the models' names.

    Raises:
        ScenarioError: If a model's file cannot be read.
    """
    found = {}
    for name, path in model_files(scenario):
        if path.suffix in (".sdf", ".urdf"):
            root = read_xml(path, warnings=[])
            found[name] = Constraints(dict(_mimics(root)), tuple(_loops(root)))
    return found


def _mimics(root: ET.Element) -> Iterator[tuple[str, Mimic]]:
    for joint in root.iter("joint"):
        for mimic in (*joint.findall(f"{{{DRAKE}}}mimic"), *joint.findall("mimic")):
            multiplier = float(mimic.get("multiplier", 1.0))
            offset = float(mimic.get("offset", 0.0))
            yield (
                joint.get("name", ""),
                Mimic(mimic.get("joint", ""), multiplier, offset),
            )


def _loops(root: ET.Element) -> Iterator[Loop]:
    for ball in root.iter(_BALL):

        def value(part: str, ball: ET.Element = ball) -> str:
            # SDF has values in texts, URDF in attributes.
            child = ball.find(f"{_BALL}_{part}")
            if child is None:
                return ""
            return child.text or child.get("name") or child.get("value") or ""

        a, b = (np.array(value(p).split(), float) for p in ("p_AP", "p_BQ"))
        yield Loop(ball.get("name", "loop"), (value("body_A"), value("body_B")), (a, b))


_KINDS = {"revolute": "revolute", "prismatic": "prismatic", "weld": "fixed"}
_FLOATING = ("quaternion_floating", "rpy_floating")
_NO_CONSTRAINTS = Constraints()


class PlantReader:
    """Describes models of a plant at its default configuration.

    Args:
        plant: The plant, finalized, with geometry.
        graph: Its scene graph.
        constraints: Constraints by model instance; see `read_constraints`.

    Raises:
        ScenarioError: If there is a soft body, or a joint that cannot be exported.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        graph: SceneGraph,
        constraints: Mapping[str, Constraints],
    ) -> None:
        self._plant, self._graph = plant, graph
        self._constraints = constraints
        self._context = plant.CreateDefaultContext()
        self._actuators = {
            actuator.joint().index(): actuator
            for actuator in map(
                plant.get_joint_actuator, plant.GetJointActuatorIndices()
            )
        }
        deformables = plant.deformable_model()
        if deformables.num_bodies():
            soft = deformables.GetBody(deformables.GetBodyIds()[0]).name()
            raise ScenarioError(
                f"objects.{soft}.soft: cannot be exported (allowed: rigid objects)"
            )
        self._joints = [plant.get_joint(j) for j in plant.GetJointIndices()]
        for joint in self._joints:
            if joint.type_name() not in (*_KINDS, *_FLOATING):
                allowed = ", ".join((*_KINDS, *_FLOATING))
                raise ScenarioError(
                    f"{self._instance(joint)}: joint {joint.name()}: cannot be "
                    f"exported: {joint.type_name()} (allowed: {allowed})"
                )

    @property
    def instances(self) -> list[str]:
        """Names of the models that have links."""
        indices = map(ModelInstanceIndex, range(1, self._plant.num_model_instances()))
        return [
            self._plant.GetModelInstanceName(index)
            for index in indices
            if self._plant.GetBodyIndices(index)
        ]

    def one(self, instance: str) -> Model:
        """Return a model by itself, without its connections to other models."""
        return self._describe(instance, [instance], prefixed=False)

    def all(self, name: str) -> Model:
        """Return all models as one; the instance's name prefixes the names of links."""
        return self._describe(name, self.instances, prefixed=True)

    def _describe(self, name: str, instances: Sequence[str], prefixed: bool) -> Model:
        def named(thing: RigidBody | DrakeJoint, own: str | None = None) -> str:
            own = own or thing.name()
            return f"{self._instance(thing)}_{own}" if prefixed else own

        indices = map(self._plant.GetModelInstanceByName, instances)
        bodies = [
            self._plant.get_body(body)
            for index in indices
            for body in self._plant.GetBodyIndices(index)
        ]
        names = {body.index(): named(body) for body in bodies}
        if prefixed:
            names[self._plant.world_body().index()] = WORLD
        floating = {
            joint.child_body().index()
            for joint in self._joints
            if joint.type_name() in _FLOATING
        }
        links = tuple(
            dc.replace(
                self._link(body),
                name=names[body.index()],
                free=body.index() in floating,
            )
            for body in bodies
        )
        joints = []
        for joint in self._joints:
            parent, child = joint.parent_body().index(), joint.child_body().index()
            if joint.type_name() in _KINDS and {parent, child} <= names.keys():
                mimic = self._of(joint).mimics.get(joint.name())
                if mimic is not None:
                    mimic = dc.replace(mimic, joint=named(joint, mimic.joint))
                joints.append(
                    dc.replace(
                        self._joint(joint, names[parent], names[child]),
                        name=named(joint),
                        mimic=mimic,
                    )
                )
        start = "{}_{}" if prefixed else "{1}"
        loops = tuple(
            dc.replace(
                loop,
                name=start.format(instance, loop.name),
                links=(
                    start.format(instance, loop.links[0]),
                    start.format(instance, loop.links[1]),
                ),
            )
            for instance in instances
            for loop in self._constraints.get(instance, _NO_CONSTRAINTS).loops
        )
        apart = tuple(
            (names[a.index()], names[b.index()]) for a, b in self._filtered(bodies)
        )
        return Model(name, links, tuple(_from_roots(joints)), loops, apart)

    def _instance(self, thing: RigidBody | DrakeJoint) -> str:
        return str(self._plant.GetModelInstanceName(thing.model_instance()))

    def _of(self, joint: DrakeJoint) -> Constraints:
        return self._constraints.get(self._instance(joint), _NO_CONSTRAINTS)

    def _link(self, body: RigidBody) -> Link:
        inertia = body.default_spatial_inertia()
        com = np.array(inertia.get_com())
        about_com = inertia.Shift(com).CalcRotationalInertia().CopyToFullMatrix3()
        return Link(
            name=body.name(),
            mass=inertia.get_mass(),
            p_LC=com,
            I_C=np.array(about_com),
            X_WL=self._plant.EvalBodyPoseInWorld(self._context, body),
            geometries=tuple(self._geometries(body)),
        )

    def _geometries(self, body: RigidBody) -> Iterator[Geometry]:
        inspector = self._graph.model_inspector()
        frame = self._plant.GetBodyFrameIdOrThrow(body.index())
        for role in (Role.kIllustration, Role.kProximity):
            for geometry in inspector.GetGeometries(frame, role):
                color, friction, modulus = None, None, math.inf
                if role == Role.kIllustration:
                    color = self._color(geometry)
                else:
                    friction = self._friction(geometry)
                    modulus = self._modulus(geometry)
                yield Geometry(
                    name=inspector.GetName(geometry).split("::")[-1],
                    shape=inspector.GetShape(geometry),
                    X_LG=inspector.GetPoseInFrame(geometry),
                    color=color,
                    friction=friction,
                    modulus=modulus,
                )

    def _color(self, geometry: GeometryId) -> tuple[float, ...]:
        properties = self._graph.model_inspector().GetIllustrationProperties(geometry)
        if not properties.HasProperty("phong", "diffuse"):
            return (0.7, 0.7, 0.7, 1.0)
        color = properties.GetProperty("phong", "diffuse")
        return (color.r(), color.g(), color.b(), color.a())

    def _friction(self, geometry: GeometryId) -> float:
        properties = self._graph.model_inspector().GetProximityProperties(geometry)
        if not properties.HasProperty("material", "coulomb_friction"):
            return 1.0  # Drake's default
        friction = properties.GetProperty("material", "coulomb_friction")
        return float(friction.dynamic_friction())

    def _modulus(self, geometry: GeometryId) -> float:
        properties = self._graph.model_inspector().GetProximityProperties(geometry)
        key = ("hydroelastic", "hydroelastic_modulus")
        has = properties.HasProperty(*key)
        return float(properties.GetProperty(*key)) if has else math.inf

    def _joint(self, joint: DrakeJoint, parent: str, child: str) -> Joint:
        X_PJ = joint.frame_on_parent().GetFixedPoseInBodyFrame()
        X_CJ = joint.frame_on_child().GetFixedPoseInBodyFrame()
        kind = _KINDS[joint.type_name()]
        if kind == "fixed":
            X_PJ = X_PJ @ joint.X_FM()
            if child == WORLD:
                parent, child, X_PJ, X_CJ = child, parent, X_CJ, X_PJ
            return Joint(joint.name(), kind, parent, child, X_PJ, X_CJ)
        revolute = kind == "revolute"
        actuator = self._actuators.get(joint.index())
        values = {}
        if actuator is not None:
            gains = None
            if actuator.has_controller():
                gains = actuator.get_controller_gains()
                gains = (gains.p, gains.d)
            values = {
                "effort": actuator.effort_limit(),
                "rotor_inertia": actuator.default_rotor_inertia(),
                "gear_ratio": actuator.default_gear_ratio(),
                "gains": gains,
            }
        return Joint(
            name=joint.name(),
            kind=kind,
            parent=parent,
            child=child,
            X_PJ=X_PJ,
            X_CJ=X_CJ,
            axis=joint.revolute_axis() if revolute else joint.translation_axis(),
            lower=joint.position_lower_limit(),
            upper=joint.position_upper_limit(),
            velocity=joint.velocity_upper_limit(),
            acceleration=joint.acceleration_upper_limit(),
            damping=joint.default_damping(),
            start=float(joint.default_positions()[0]),
            **values,
        )

    def _filtered(
        self, bodies: Sequence[RigidBody]
    ) -> Iterator[tuple[RigidBody, RigidBody]]:
        """Yield the pairs of bodies whose contacts are all filtered out.

        Bodies that share a joint are left out, because every simulator filters those.
        """
        inspector = self._graph.model_inspector()
        jointed = {
            frozenset((joint.parent_body().index(), joint.child_body().index()))
            for joint in self._joints
        }
        welded = {
            body.index(): frozenset(
                b.index() for b in self._plant.GetBodiesWeldedTo(body)
            )
            for body in bodies
        }
        shapes = {
            body.index(): self._plant.GetCollisionGeometriesForBody(body)
            for body in bodies
        }
        solid = [body for body in bodies if shapes[body.index()]]
        for i, a in enumerate(solid):
            for b in solid[i + 1 :]:
                if (
                    b.index() not in welded[a.index()]
                    and frozenset((a.index(), b.index())) not in jointed
                    and all(
                        inspector.CollisionFiltered(one, other)
                        for one in shapes[a.index()]
                        for other in shapes[b.index()]
                    )
                ):
                    yield a, b


def _from_roots(joints: Sequence[Joint]) -> Iterator[Joint]:
    """Yield the joints, parents before children.

    Raises:
        ScenarioError: If joints form a loop.
    """
    waiting = list(joints)
    while waiting:
        children = {joint.child for joint in waiting}
        ready = [joint for joint in waiting if joint.parent not in children]
        if not ready:
            name = waiting[0].name
            raise ScenarioError(f"joint {name}: cannot be exported: part of a loop")
        yield from ready
        waiting = [joint for joint in waiting if joint not in ready]
