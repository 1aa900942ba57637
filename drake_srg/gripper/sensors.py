"""Sensors in the finger links: layout, distance and contact force."""

import abc
import dataclasses as dc
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import GeometryId, QueryObject
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    System,
)

from drake_srg.common.contacts import Contact, each_contact
from drake_srg.config import Config, positive
from drake_srg.gripper.underactuation import FINGERS, JOINT_NAMES
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector

# Inner normal of every link with a sensor, in the link's frame, whose y points to the
# closing side.
INWARD = np.array([0.0, 1.0, 0.0])
INWARD.setflags(write=False)


@dc.dataclass(frozen=True, kw_only=True)
class FingerLayout:
    """The joints, links and fingers of a gripper, for its drivers and sensors.

    Attributes:
        joint_names: Joints with an encoder, in the order of all vectors with one entry
            per joint.
        sensor_links: The link that carries each sensor, by the sensor's name, in the
            order of all vectors with one entry per sensor.
        fingers: The indices of the sensors of each finger.
        seen: The gripper's own links that a distance sensor sees, by the sensor's name.
            A sensor without an entry sees no link of the gripper.
    """

    joint_names: tuple[str, ...]
    sensor_links: Mapping[str, str]
    fingers: tuple[tuple[int, ...], ...]
    seen: Mapping[str, tuple[str, ...]]

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """The sensors' names, in order."""
        return tuple(self.sensor_links)


SRG_FINGERS = FingerLayout(
    joint_names=JOINT_NAMES,
    sensor_links={
        name: f"{name}_link"
        for name in (joint.removesuffix("_joint") for joint in JOINT_NAMES)
    },
    fingers=FINGERS,
    seen={
        "left_tip": ("right_base_link", "right_tip_link"),
        "right_tip": ("left_base_link", "left_tip_link"),
    },
)

LINKAGE_FINGERS = FingerLayout(
    joint_names=("master_crank_joint", "slave_crank_joint"),
    sensor_links={"master_tip": "master_tip", "slave_tip": "slave_tip"},
    fingers=((0,), (1,)),
    seen={"master_tip": ("slave_tip",), "slave_tip": ("master_tip",)},
)


class FingerSensorConfig(Config, abc.ABC):
    """Configuration of a sensor in the fingers; derive a dataclass from it.

    A field of this type in a driver's configuration adds the sensor to that driver.
    `AddFingerSensing` connects the sensor's ports.
    """

    @abc.abstractmethod
    def AddSensor(
        self,
        builder: DiagramBuilder,
        plant: MultibodyPlant,
        gripper: ModelInstanceIndex,
        layout: FingerLayout,
    ) -> System:
        """Add the sensor to a driver, unconnected, and return it.

        Args:
            builder: The driver under construction.
            plant: Plant with the gripper, finalized.
            gripper: Its model instance.
            layout: The links that carry sensors, in the order of the readings.
        """


@dc.dataclass(kw_only=True)
class ProximityConfig(FingerSensorConfig):
    """Field of view, range, trigger and rate of the distance sensors."""

    # Readings saturate here [m]. A longer range takes more time, because more pairs of
    # geometries are near.
    range: float = dc.field(default=0.02, metadata=positive())
    # A sensor fires below this distance [m].
    trigger_distance: float = dc.field(default=0.003, metadata=positive())
    # Half angle of the cone about the link's inner normal in which a sensor sees [rad];
    # pi: all round. With 60 degrees, a sensor sees objects whose sides are oblique to
    # the pad by up to 60 degrees. It does not see a table below links that are within
    # 30 degrees of upright. A face misses an object at the trigger distance only over
    # its outer 1.7 mm (see `ProximitySensors`).
    half_angle: float = dc.field(
        default=math.radians(60.0), metadata=positive(le=math.pi)
    )
    # Time between readings [s]. A reading takes 0.2 ms; at 100 Hz, that is a twelfth of
    # the plant's time. Algorithm 1 and the reference are sampled at the same rate, and
    # each uses the previous value of the one before. So a finger reacts 20 to 35 ms
    # after it comes near something. Meanwhile, its end moves at most 13 mm (3.67 rad/s
    # over 0.1 m).
    period: float = dc.field(default=0.01, metadata=positive())

    def AddSensor(
        self,
        builder: DiagramBuilder,
        plant: MultibodyPlant,
        gripper: ModelInstanceIndex,
        layout: FingerLayout,
    ) -> "ProximitySensors":
        """Add the sensor to a driver, unconnected, and return it.

        Each sensor ignores the gripper's own links, except those in `layout.seen`.
        """

        def geometries(link: str) -> list[GeometryId]:
            body = plant.GetBodyByName(link, gripper)
            return list(plant.GetCollisionGeometriesForBody(body))

        bodies = [plant.get_body(index) for index in plant.GetBodyIndices(gripper)]
        own = {body.name(): geometries(body.name()) for body in bodies}
        sensors = {name: own[link] for name, link in layout.sensor_links.items()}
        ignored = {
            name: [
                g for link in own.keys() - layout.seen.get(name, ()) for g in own[link]
            ]
            for name in sensors
        }
        return builder.AddNamedSystem(
            "proximity_sensors", ProximitySensors(sensors, ignored, self)
        )


class ProximitySensors(LeafSystem):
    """Measures signed distances from finger links to things near them.

    .. pydrake_system::

        name: ProximitySensors
        input_ports:
        - query_object
        output_ports:
        - proximity
        - triggered

    `proximity` (m) [m] is the least signed distance from each sensor's geometries to
    any geometry that it sees, saturated at `config.range`. Negative values are
    penetration. `triggered` (m) is 1 where the distance is below
    `config.trigger_distance`, else 0. Both are sampled every `config.period`.

    A geometry of a sensor sees another geometry if the direction to that one's nearest
    point (in penetration: the contact normal) is within `config.half_angle` of the
    link's inner normal. A flat face can miss a convex object in front of it, but only
    at the rim: if the object is h above the face there, the face's edge is at most
    h / tan(half_angle) away. The geometries of a link do not block each other's view.
    So an object in the corner between two of them counts, although it is beside the
    nearer one. Likewise, a geometry behind a pad can see a round object at the pad's
    end, from farther away.

    Args:
        sensors: The geometries from which each sensor measures, by its name.
        ignored: The geometries that each sensor does not see, by its name.
        config: Field of view, range, trigger and rate.
    """

    def __init__(
        self,
        sensors: Mapping[str, Sequence[GeometryId]],
        ignored: Mapping[str, Sequence[GeometryId]],
        config: ProximityConfig | None = None,
    ) -> None:
        super().__init__()
        self.config = config or ProximityConfig()
        self.sensor_names = list(sensors)
        # Numbers, not ids: an id from a plant keeps the plant and its diagram alive,
        # and the garbage collector does not see that reference.
        self._sensor_of = {
            g.get_value(): i for i, gs in enumerate(sensors.values()) for g in gs
        }
        self._ignored = [{g.get_value() for g in ignored.get(n, ())} for n in sensors]
        # The margin keeps rounding from narrowing the field of view.
        self._least_cosine = math.cos(self.config.half_angle) - 1e-9
        self._query = self.DeclareAbstractInputPort(
            name="query_object", model_value=AbstractValue.Make(QueryObject())
        )
        distances = self.DeclareDiscreteState([self.config.range] * len(sensors))
        self.DeclareStateOutputPort("proximity", distances)
        self.DeclareVectorOutputPort(
            name="triggered",
            size=len(sensors),
            calc=self._calc_triggered,
            prerequisites_of_calc={self.xd_ticket()},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=self.config.period, offset_sec=0.0, update=self._update
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        query = self._query.Eval(context)
        distances = [self.config.range] * len(self.sensor_names)
        normals: dict[int, Vector] = {}  # of the sensors with something near, in world
        for pair in query.ComputeSignedDistancePairwiseClosestPoints(self.config.range):
            A, B = pair.id_A, pair.id_B
            a, b, distance = A.get_value(), B.get_value(), pair.distance
            for own, other, is_A in ((a, b, True), (b, a, False)):
                i = self._sensor_of.get(own)
                # Most pairs belong to the gripper's own links, which no sensor sees.
                if i is None or other in self._ignored[i] or distance >= distances[i]:
                    continue
                if i not in normals:
                    frame = query.inspector().GetFrameId(A if is_A else B)
                    normals[i] = query.GetPoseInWorld(frame).rotation() @ INWARD
                away = normals[i] @ pair.nhat_BA_W
                # For a touch in a single point, the direction may be NaN; it counts.
                if not (-away if is_A else away) < self._least_cosine:
                    distances[i] = distance
        discrete_state.set_value(distances)

    def _calc_triggered(self, context: Context, output: BasicVector) -> None:
        distances = context.get_discrete_state(0).value()
        fired = distances < self.config.trigger_distance
        output.SetFromVector(fired.astype(float))


@dc.dataclass(kw_only=True)
class TouchConfig(FingerSensorConfig):
    """Threshold of the touch sensors."""

    # A sensor fires at this force and above [N]. The readings of thin-film force
    # sensors begin at 0.1 to 0.5 N.
    trigger_force: float = dc.field(default=0.5, metadata=positive())

    def AddSensor(
        self,
        builder: DiagramBuilder,
        plant: MultibodyPlant,
        gripper: ModelInstanceIndex,
        layout: FingerLayout,
    ) -> "ContactForceSensors":
        """Add the sensor to a driver, unconnected, and return it."""
        links = {}
        for name, link in layout.sensor_links.items():
            body = plant.GetBodyByName(link, gripper)
            links[name] = (body.index(), plant.GetCollisionGeometriesForBody(body))
        return builder.AddNamedSystem(
            "contact_force_sensors", ContactForceSensors(links, self)
        )


class ContactForceSensors(LeafSystem):
    """Measures the contact forces on each finger link.

    .. pydrake_system::

        name: ContactForceSensors
        input_ports:
        - contact_results
        - body_poses
        output_ports:
        - contact_force
        - contact_wrench
        - triggered

    `contact_results` and `body_poses` are outputs of the plant. The outputs have one
    entry per sensor and are computed when they are read:

    * `contact_force` (m) [N]: force on the closing side, as a force sensor under the
      pad reads it: the sum of all contact forces against the link's inner normal, at
      least 0;
    * `contact_wrench` (6m) [N m, N]: [torque; force] of all contacts on each link, at
      the link's origin, in the link's frame;
    * `triggered` (m): 1 where the force is `config.trigger_force` or more, else 0.

    Args:
        links: The index of the body of each sensor and the body's collision geometries,
            by the sensor's name.
        config: Threshold of the force.
    """

    def __init__(
        self,
        links: Mapping[str, tuple[BodyIndex, Sequence[GeometryId]]],
        config: TouchConfig | None = None,
    ) -> None:
        super().__init__()
        self.config = config or TouchConfig()
        self.sensor_names = list(links)
        # Numbers, not ids: see ProximitySensors.
        self._bodies = [int(body) for body, _ in links.values()]
        self._sensor_of_geometry = {
            g.get_value(): i for i, (_, gs) in enumerate(links.values()) for g in gs
        }
        self._contacts = self.DeclareAbstractInputPort(
            name="contact_results", model_value=AbstractValue.Make(ContactResults())
        )
        self._poses = self.DeclareAbstractInputPort(
            name="body_poses", model_value=AbstractValue.Make([RigidTransform()])
        )
        for name, size, calc in (
            ("contact_force", 1, self._calc_contact_force),
            ("contact_wrench", 6, self._calc_contact_wrench),
            ("triggered", 1, self._calc_triggered),
        ):
            self.DeclareVectorOutputPort(
                name=name,
                size=size * len(links),
                calc=calc,
                prerequisites_of_calc={self.all_input_ports_ticket()},
            )

    def _applied(
        self, context: Context
    ) -> Iterator[tuple[int, RigidTransform, float, Contact]]:
        """Yield each contact on a link: sensor, link's pose, sign, contact.

        `sign` times the contact's force on A is the force on the link.
        """
        poses: list[RigidTransform] = []  # read at the first contact
        for contact in each_contact(self._contacts.Eval(context)):
            for id_, sign in ((contact.id_A, 1.0), (contact.id_B, -1.0)):
                sensor = self._sensor_of_geometry.get(id_)
                if sensor is not None:
                    poses = poses or self._poses.Eval(context)
                    yield sensor, poses[self._bodies[sensor]], sign, contact

    def _calc_contact_wrench(self, context: Context, output: BasicVector) -> None:
        wrenches = np.zeros((len(self._bodies), 6))
        for sensor, X_WL, sign, contact in self._applied(context):
            F_Ac_W = contact.F_Ac_W()
            R_LW = X_WL.rotation().matrix().T
            force = sign * F_Ac_W.translational()
            lever = contact.p_WC() - X_WL.translation()
            moment = sign * F_Ac_W.rotational() + np.cross(lever, force)
            wrenches[sensor] += np.concatenate([R_LW @ moment, R_LW @ force])
        output.SetFromVector(wrenches.flatten())

    def _forces(self, context: Context) -> Vector:
        """Return the force on the closing side of each link, shape (m,) [N]."""
        # Not from `contact_wrench`, because torques would take four times as long.
        forces = np.zeros((len(self._bodies), 3))
        for sensor, X_WL, sign, contact in self._applied(context):
            R_WL = X_WL.rotation().matrix()
            forces[sensor] += R_WL.T @ (sign * contact.F_Ac_W().translational())
        # A force on the closing side points outwards.
        return np.maximum(-forces @ INWARD, 0.0)

    def _calc_contact_force(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._forces(context))

    def _calc_triggered(self, context: Context, output: BasicVector) -> None:
        fired = self._forces(context) >= self.config.trigger_force
        output.SetFromVector(fired.astype(float))
