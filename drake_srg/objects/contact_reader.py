"""What touches an object, and how hard: ground truth for metrics."""

import numpy as np
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from drake_srg.common.contacts import each_contact


class ContactReader:
    """Reads from contact results what touches one object, and how hard."""

    def __init__(self, plant: MultibodyPlant, name: str) -> None:
        own = plant.GetModelInstanceByName(name)
        self._name = name
        self._keys: dict[int, str] = {}  # of each geometry's model, by its number
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

        Keys are `gripper`, `arm`, the names of other objects, and `support` for
        everything else.
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
