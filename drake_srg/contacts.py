"""What touches an object, and how hard: ground truth for metrics."""

import numpy as np
from pydrake.geometry import GeometryId
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from drake_srg.types import Vector


class ContactReader:
    """Reads from contact results what touches one object, and how hard."""

    def __init__(self, plant: MultibodyPlant, name: str) -> None:
        own = plant.GetModelInstanceByName(name)
        self._name = name
        self._keys: dict[GeometryId, str] = {}  # of each geometry's model
        deformables = plant.deformable_model()
        for model in map(ModelInstanceIndex, range(plant.num_model_instances())):
            key = plant.GetModelInstanceName(model)
            for body in map(plant.get_body, plant.GetBodyIndices(model)):
                free = body.is_floating_base_body()
                named = model == own or free or key in ("arm", "gripper")
                for geometry in plant.GetCollisionGeometriesForBody(body):
                    self._keys[geometry] = key if named else "support"
            for body_id in deformables.GetBodyIds(model):
                self._keys[deformables.GetGeometryId(body_id)] = key

    def forces(self, contacts: ContactResults) -> dict[str, float]:
        """Return the largest contact force with each kind of body [N].

        Keys are `gripper`, `arm`, the names of other objects, and `support` for
        everything else.
        """
        forces: dict[str, float] = {}
        for i in range(contacts.num_hydroelastic_contacts()):
            info = contacts.hydroelastic_contact_info(i)
            surface = info.contact_surface()
            force = info.F_Ac_W().translational()
            self._add(forces, surface.id_M(), surface.id_N(), force)
        for i in range(contacts.num_deformable_contacts()):
            soft = contacts.deformable_contact_info(i)
            force = soft.F_Ac_W().translational()
            self._add(forces, soft.id_A(), soft.id_B(), force)
        for i in range(contacts.num_point_pair_contacts()):
            info = contacts.point_pair_contact_info(i)
            pair = info.point_pair()
            self._add(forces, pair.id_A, pair.id_B, info.contact_force())
        return forces

    def _add(
        self, forces: dict[str, float], a: GeometryId, b: GeometryId, force: Vector
    ) -> None:
        for own, other in ((a, b), (b, a)):
            if self._keys[own] == self._name:
                key = self._keys[other]
                forces[key] = max(forces.get(key, 0.0), float(np.linalg.norm(force)))
