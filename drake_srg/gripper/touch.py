"""Force sensors in the finger links, which read the plant's contacts."""

import dataclasses as dc
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import GeometryId
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder

from drake_srg.common.contacts import Contact, each_contact
from drake_srg.gripper.finger_layout import INWARD, FingerLayout
from drake_srg.gripper.finger_sensor import FingerSensorConfig
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector, positive


@dc.dataclass(kw_only=True)
class TouchConfig(FingerSensorConfig):
    """When a touch counts."""

    # A sensor fires at this force and above [N]. Thin-film force sensors begin to read
    # at 0.1 to 0.5 N.
    trigger_force: float = dc.field(default=0.5, metadata=positive())

    def AddSensor(
        self,
        builder: DiagramBuilder,
        plant: MultibodyPlant,
        gripper: ModelInstanceIndex,
        layout: FingerLayout,
    ) -> "ContactForceSensors":
        """See `FingerSensorConfig`."""
        return AddContactForceSensors(builder, plant, gripper, layout, self)


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

    `contact_results` and `body_poses` are the plant's. The outputs have one entry per
    sensor and are computed when they are read:

    * `contact_force` (m) [N]: pressure on the closing side, as a force sensor under the
      pad reads it: the sum of all contact forces against the link's inner normal, at
      least 0;
    * `contact_wrench` (6m) [N m, N]: [torque; force] of all contacts on each link, at
      the link's origin, in the link's frame;
    * `triggered` (m): 1 where the force is `config.trigger_force` or more, else 0.

    Args:
        links: The index of the body of each sensor and the body's collision geometries,
            by the sensor's name.
        config: When a touch counts.
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
        """Yield each contact on a link: sensor, link's pose, sign of A's force."""
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
        """Return the pressure on the closing side of each link, shape (m,) [N]."""
        # Without the torques, which would take four times as long.
        forces = np.zeros((len(self._bodies), 3))
        for sensor, X_WL, sign, contact in self._applied(context):
            R_WL = X_WL.rotation().matrix()
            forces[sensor] += R_WL.T @ (sign * contact.F_Ac_W().translational())
        # Pressure on the closing side pushes outwards.
        return np.maximum(-forces @ INWARD, 0.0)

    def _calc_contact_force(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._forces(context))

    def _calc_triggered(self, context: Context, output: BasicVector) -> None:
        fired = self._forces(context) >= self.config.trigger_force
        output.SetFromVector(fired.astype(float))


def AddContactForceSensors(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex,
    layout: FingerLayout,
    config: TouchConfig | None = None,
) -> ContactForceSensors:
    """Add a gripper's force sensors to a diagram with its (finalized) plant.

    The caller connects the inputs.
    """
    links = {}
    for name, link in layout.sensor_links.items():
        body = plant.GetBodyByName(link, gripper)
        links[name] = (body.index(), plant.GetCollisionGeometriesForBody(body))
    return builder.AddNamedSystem(
        "contact_force_sensors", ContactForceSensors(links, config)
    )
