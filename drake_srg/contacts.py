"""What touches an object, and how hard: ground truth for metrics."""

import numpy as np
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody

from drake_srg.types import Vector


class ContactReader:
    """Reads from contact results what touches one object, and how hard."""

    def __init__(self, plant: MultibodyPlant, name: str) -> None:
        self._model = plant.GetModelInstanceByName(name)
        self._plant = plant
        self._bodies = {
            geometry: plant.get_body(index)
            for model in range(plant.num_model_instances())
            for index in plant.GetBodyIndices(ModelInstanceIndex(model))
            for geometry in plant.GetCollisionGeometriesForBody(plant.get_body(index))
        }

    def forces(self, contacts: ContactResults) -> dict[str, float]:
        """Return the largest contact force with each kind of body [N].

        Keys are `gripper`, `arm`, the names of other objects, and `support` for
        everything else.
        """
        forces: dict[str, float] = {}
        for i in range(contacts.num_hydroelastic_contacts()):
            info = contacts.hydroelastic_contact_info(i)
            surface = info.contact_surface()
            self._add(
                forces,
                self._bodies[surface.id_M()],
                self._bodies[surface.id_N()],
                info.F_Ac_W().translational(),
            )
        for i in range(contacts.num_point_pair_contacts()):
            pair = contacts.point_pair_contact_info(i)
            self._add(
                forces,
                self._plant.get_body(pair.bodyA_index()),
                self._plant.get_body(pair.bodyB_index()),
                pair.contact_force(),
            )
        return forces

    def _add(
        self, forces: dict[str, float], a: RigidBody, b: RigidBody, force: Vector
    ) -> None:
        for own, other in ((a, b), (b, a)):
            if own.model_instance() != self._model:
                continue
            key = self._plant.GetModelInstanceName(other.model_instance())
            if key not in ("arm", "gripper") and not other.is_floating_base_body():
                key = "support"
            forces[key] = max(forces.get(key, 0.0), float(np.linalg.norm(force)))
