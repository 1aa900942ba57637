"""Distance sensors in the finger links."""

import dataclasses as dc
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

from drake_srg.gripper.finger_layout import FingerLayout
from drake_srg.gripper.finger_sensor import FingerSensorConfig
from drake_srg.lifetime import LeafSystem
from drake_srg.types import positive


@dc.dataclass(kw_only=True)
class ProximityConfig(FingerSensorConfig):
    """Range, trigger and rate of the distance sensors."""

    # Readings saturate here [m]. A longer range costs time because more pairs are near.
    range: float = dc.field(default=0.02, metadata=positive())
    # A sensor fires below this distance [m].
    trigger_distance: float = dc.field(default=0.003, metadata=positive())
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
    any geometry that it does not ignore, saturated at `config.range`. Negative values
    are penetration. `triggered` (m) is 1 where the distance is below
    `config.trigger_distance`, else 0. Both are sampled every `config.period`.

    Args:
        sensors: The geometries from which each sensor measures, by its name.
        ignored: The geometries that each sensor does not see, by its name.
        config: Range, trigger and rate.
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
        self.DeclareAbstractInputPort(
            name="query_object", model_value=AbstractValue.Make(QueryObject())
        )
        state = self.DeclareDiscreteState([self.config.range] * len(sensors))
        for name, calc in (
            ("proximity", self._calc_proximity),
            ("triggered", self._calc_triggered),
        ):
            self.DeclareVectorOutputPort(
                name=name,
                size=len(sensors),
                calc=calc,
                prerequisites_of_calc={self.discrete_state_ticket(state)},
            )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=self.config.period, offset_sec=0.0, update=self._update
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        query: QueryObject = self.get_input_port(0).Eval(context)
        distances = [self.config.range] * len(self.sensor_names)
        for pair in query.ComputeSignedDistancePairwiseClosestPoints(self.config.range):
            a, b = pair.id_A.get_value(), pair.id_B.get_value()
            for own, other in ((a, b), (b, a)):
                i = self._sensor_of.get(own)
                if i is not None and other not in self._ignored[i]:
                    distances[i] = min(distances[i], pair.distance)
        discrete_state.set_value(distances)

    def _calc_proximity(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state(0).value())

    def _calc_triggered(self, context: Context, output: BasicVector) -> None:
        distances = context.get_discrete_state(0).value().tolist()
        trigger = self.config.trigger_distance
        output.SetFromVector([float(distance < trigger) for distance in distances])


def AddProximitySensors(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex,
    layout: FingerLayout,
    config: ProximityConfig | None = None,
) -> ProximitySensors:
    """Add a gripper's distance sensors to a diagram with its (finalized) plant.

    Each sensor sees everything except the gripper's own links; `layout.seen` lists the
    own links that it does see. The caller connects `query_object` to the scene graph.
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
