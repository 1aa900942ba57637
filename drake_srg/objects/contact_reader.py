"""Contact forces on an object: ground truth for metrics."""

import numpy as np
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from drake_srg.common.contacts import each_contact


class ContactReader:
    """Reads the contact forces on one object from a plant's contact results.

    Args:
        plant: The finalized plant that computes the results.
        name: Model instance of the object.
    """

    def __init__(self, plant: MultibodyPlant, name: str) -> None:
        own = plant.GetModelInstanceByName(name)
        self._name = name
        self._keys: dict[int, str] = {}  # by the geometry's number
        deformables = plant.deformable_model()
        for model in map(ModelInstanceIndex, range(plant.num_model_instances())):
            key = plant.GetModelInstanceName(model)
            for body in map(plant.get_body, plant.GetBodyIndices(model)):
                free = body.is_floating_base_body()
                named = model == own or free or key in ("arm", "gripper")
                for geometry in plant.GetCollisionGeometriesForBody(body):
                    self._keys[geometry.get_value()] = key if named else "support"
            for body_id in deformables.GetBodyIds(model):
                self._keys[deformables.GetGeometryId(body_id).get_value()] = key

    def forces(self, contacts: ContactResults) -> dict[str, float]:
        """Return the largest contact force with each kind of body [N].

        Args:
            contacts: Value of the plant's output port `contact_results`.

        Returns:
            Forces by `gripper`, `arm`, the names of other objects, and `support` for
            everything else. Only bodies that touch the object appear.
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
