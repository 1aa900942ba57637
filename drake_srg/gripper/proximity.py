"""Distance sensors in the finger links."""

import dataclasses as dc
import math
from collections.abc import Mapping, Sequence

from pydrake.common.value import AbstractValue
from pydrake.geometry import GeometryId, QueryObject
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
)

from drake_srg.gripper.finger_layout import INWARD, FingerLayout
from drake_srg.gripper.finger_sensor import FingerSensorConfig
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector, positive


@dc.dataclass(kw_only=True)
class ProximityConfig(FingerSensorConfig):
    """Field of view, range, trigger and rate of the distance sensors."""

    # Readings saturate here [m]. A longer range costs time because more pairs are near.
    range: float = dc.field(default=0.02, metadata=positive())
    # A sensor fires below this distance [m].
    trigger_distance: float = dc.field(default=0.003, metadata=positive())
    # Half angle of the cone about the link's inner normal in which a sensor sees [rad];
    # pi: all round. 60 degrees show an object whose side is so oblique to the pad, and
    # hide a table below links that are within 30 degrees of upright. An object at the
    # trigger distance escapes a face only over its outer 1.7 mm (`ProximitySensors`).
    half_angle: float = dc.field(
        default=math.radians(60.0), metadata=positive(le=math.pi)
    )
    # Time between readings [s]. A reading costs 0.2 ms, at 100 Hz a twelfth of the time
    # that the plant needs. Algorithm 1 and the reference, sampled at the same rate,
    # each see the other's last value, so a finger reacts 20 to 35 ms after it comes
    # near something. Meanwhile, its end moves at most 13 mm (3.67 rad/s over 0.1 m).
    period: float = dc.field(default=0.01, metadata=positive())

    def AddSensor(
        self,
        builder: DiagramBuilder,
        plant: MultibodyPlant,
        gripper: ModelInstanceIndex,
        layout: FingerLayout,
    ) -> "ProximitySensors":
        """See `FingerSensorConfig`."""
        return AddProximitySensors(builder, plant, gripper, layout, self)


class ProximitySensors(LeafSystem):
    """Measures signed distances from finger links to whatever is near them.

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

    A geometry of a sensor sees another one if the direction to its nearest point (in
    penetration: the contact normal) is within `config.half_angle` of the link's inner
    normal. Nothing within that angle is nearer. A convex object that a flat face does
    not see can reach in front of the face, but only at the rim: where it is h above the
    face, the face's edge is at most h / tan(half_angle) away. The geometries of a link
    look past each other: an object in the corner between two of them counts, though
    the nearer one has it beside itself. So what lies behind a pad can see, from farther
    away, a round object at the pad's end.

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
        # where the garbage collector does not see it.
        self._sensor_of = {
            g.get_value(): i for i, gs in enumerate(sensors.values()) for g in gs
        }
        self._ignored = [{g.get_value() for g in ignored.get(n, ())} for n in sensors]
        # Rounding must not narrow the field of view.
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
                # Most pairs are of the gripper's own links, which no sensor sees.
                if i is None or other in self._ignored[i] or distance >= distances[i]:
                    continue
                if i not in normals:
                    frame = query.inspector().GetFrameId(A if is_A else B)
                    normals[i] = query.GetPoseInWorld(frame).rotation() @ INWARD
                away = normals[i] @ pair.nhat_BA_W
                # A touch in a single point can lack a direction (NaN): it counts.
                if not (-away if is_A else away) < self._least_cosine:
                    distances[i] = distance
        discrete_state.set_value(distances)

    def _calc_triggered(self, context: Context, output: BasicVector) -> None:
        distances = context.get_discrete_state(0).value()
        fired = distances < self.config.trigger_distance
        output.SetFromVector(fired.astype(float))


def AddProximitySensors(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex,
    layout: FingerLayout,
    config: ProximityConfig | None = None,
) -> ProximitySensors:
    """Add a gripper's distance sensors to a diagram with its (finalized) plant.

    Each sensor ignores the gripper's own links, except those in `layout.seen`. The
    caller connects `query_object` to the scene graph.
    """

    def geometries(link: str) -> list[GeometryId]:
        body = plant.GetBodyByName(link, gripper)
        return list(plant.GetCollisionGeometriesForBody(body))

    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(gripper)]
    own = {body.name(): geometries(body.name()) for body in bodies}
    sensors = {name: own[link] for name, link in layout.sensor_links.items()}
    ignored = {
        name: [g for link in own.keys() - layout.seen.get(name, ()) for g in own[link]]
        for name in sensors
    }
    return builder.AddNamedSystem(
        "proximity_sensors", ProximitySensors(sensors, ignored, config)
    )
