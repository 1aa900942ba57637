"""Ground truth about objects, for metrics only: poses and contact forces."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import GeometryConfigurationVector, GeometryId
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, DeformableBody, ModelInstanceIndex
from pydrake.systems.framework import Context, DiscreteValues

from drake_srg.common.contacts import each_contact
from drake_srg.lifetime import LeafSystem
from drake_srg.objects.soft import nearest_pose
from drake_srg.types import Vector


class ObjectPoses(LeafSystem):
    """Outputs the poses of bodies by name.

    .. pydrake_system::

        name: ObjectPoses
        input_ports:
        - body_poses
        - deformable_body_configuration (where there are soft objects)
        output_ports:
        - object_poses

    The inputs are outputs of the plant (list[RigidTransform],
    GeometryConfigurationVector). `object_poses` is a dict[str, RigidTransform], X_WO by
    object name [m]. The pose of a soft object is the rigid motion nearest to the motion
    of its vertices.

    Args:
        bodies: The body of each object, rigid (its index) or soft.
    """

    def __init__(self, bodies: Mapping[str, BodyIndex | DeformableBody]) -> None:
        super().__init__()
        self._bodies = {n: b for n, b in bodies.items() if isinstance(b, BodyIndex)}
        # The geometry's id, and its undeformed vertices in the object's frame.
        self._soft: dict[str, tuple[GeometryId, Vector]] = {
            n: (b.geometry_id(), b.reference_positions().reshape(-1, 3).T)
            for n, b in bodies.items()
            if isinstance(b, DeformableBody)
        }
        poses = self.DeclareAbstractInputPort(
            name="body_poses", model_value=AbstractValue.Make([RigidTransform()])
        )
        tickets = {poses.ticket()}
        if self._soft:
            vertices = self.DeclareAbstractInputPort(
                name="deformable_body_configuration",
                model_value=AbstractValue.Make(GeometryConfigurationVector()),
            )
            tickets.add(vertices.ticket())
        self.DeclareAbstractOutputPort(
            name="object_poses",
            alloc=lambda: AbstractValue.Make({}),
            calc=self._calc_object_poses,
            prerequisites_of_calc=tickets,
        )

    def _calc_object_poses(self, context: Context, output: AbstractValue) -> None:
        body_poses = self.get_input_port(0).Eval(context)
        poses = {name: body_poses[body] for name, body in self._bodies.items()}
        if self._soft:
            vertices = self.get_input_port(1).Eval(context)
            for name, (geometry, p_OV) in self._soft.items():
                p_WV = vertices.value(geometry).reshape(-1, 3).T
                poses[name] = nearest_pose(p_OV, p_WV)
        output.set_value(poses)


class ContactReader:
    """Reads the contact forces on one object from a plant's contact results.

    Args:
        plant: The finalized plant that computes the results.
        name: Model instance of the object.
        robots: Model instances of arms and grippers.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        name: str,
        robots: Collection[str] = ("arm", "gripper"),
    ) -> None:
        own = plant.GetModelInstanceByName(name)
        self._name = name
        self._keys: dict[int, str] = {}  # by the geometry's number
        deformables = plant.deformable_model()
        for model in map(ModelInstanceIndex, range(plant.num_model_instances())):
            key = plant.GetModelInstanceName(model)
            for body in map(plant.get_body, plant.GetBodyIndices(model)):
                free = body.is_floating_base_body()
                named = model == own or free or key in robots
                for geometry in plant.GetCollisionGeometriesForBody(body):
                    self._keys[geometry.get_value()] = key if named else "support"
            for body_id in deformables.GetBodyIds(model):
                self._keys[deformables.GetGeometryId(body_id).get_value()] = key

    def forces(self, contacts: ContactResults) -> dict[str, float]:
        """Return the largest contact force between the object and each other body [N].

        Args:
            contacts: Value of the plant's output port `contact_results`.

        Returns:
            Forces by name of gripper, arm or other object, and under `support` that
            with anything else. Only bodies that touch the object appear.
        """
        forces: dict[str, float] = {}
        for contact in each_contact(contacts):
            for own, other in (
                (contact.id_A, contact.id_B),
                (contact.id_B, contact.id_A),
            ):
                if self._keys[own] == self._name:
                    key = self._keys[other]
                    force = np.linalg.norm(contact.F_Ac_W().translational())
                    forces[key] = max(forces.get(key, 0.0), float(force))
        return forces


class PeakForce(LeafSystem):
    """Remembers the greatest contact force between two models.

    .. pydrake_system::

        name: PeakForce
        input_ports:
        - contact_results
        output_ports:
        - peak_force

    The input is the plant's output. `peak_force` is the greatest force so far, shape
    (1,) [N]. A force is the resultant of all contacts at one time, as a force sensor
    under one of the models would measure it.

    Args:
        plant: The finalized plant.
        names: Two model instances.
        period: Time between readings [s]. With a discrete plant's time step, no step is
            missed.

    Raises:
        RuntimeError: If the plant has no such model.
    """

    def __init__(
        self, plant: MultibodyPlant, names: tuple[str, str], period: float
    ) -> None:
        super().__init__()
        self._ids = [
            {
                geometry.get_value()
                for body in plant.GetBodyIndices(plant.GetModelInstanceByName(name))
                for geometry in plant.GetCollisionGeometriesForBody(
                    plant.get_body(body)
                )
            }
            for name in names
        ]
        self._contacts = self.DeclareAbstractInputPort(
            name="contact_results", model_value=AbstractValue.Make(ContactResults())
        )
        state = self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        self.DeclareStateOutputPort("peak_force", state)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        peak = context.get_discrete_state_vector().value()[0]
        force = self._force(self._contacts.Eval(context))
        values.set_value([max(peak, force)])

    def _force(self, contacts: ContactResults) -> float:
        one, other = self._ids
        total = np.zeros(3)
        for contact in each_contact(contacts):
            if contact.id_A in one and contact.id_B in other:
                total += contact.F_Ac_W().translational()
            elif contact.id_A in other and contact.id_B in one:
                total -= contact.F_Ac_W().translational()
        return float(np.linalg.norm(total))
