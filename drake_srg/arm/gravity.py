"""Gravity compensation of an arm."""

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import BasicVector, Context

from drake_srg.lifetime import LeafSystem


class GravityCompensation(LeafSystem):
    """Computes the torques that hold an arm against gravity.

    .. pydrake_system::

        name: GravityCompensation
        input_ports:
        - MODEL_state (each model)
        output_ports:
        - torque

    The inputs are the states [q; v] of the model instances `models`, in the order of
    the plant's state output ports. `torque` (N) [N m] belongs to the first model, in
    the order of its velocities. Pydrake's InverseDynamics does the same but does not
    keep its plant alive.

    Args:
        plant: A finalized plant with these models and no other moving body.
        models: Names of the model instances, the arm's first.
    """

    def __init__(self, plant: MultibodyPlant, models: Sequence[str]) -> None:
        super().__init__()
        self._plant = plant
        self._plant_context = plant.CreateDefaultContext()  # scratch, not state
        self._models = [plant.GetModelInstanceByName(name) for name in models]
        self._states = [
            self.DeclareVectorInputPort(
                name=f"{name}_state", size=plant.num_multibody_states(model)
            )
            for name, model in zip(models, self._models, strict=True)
        ]
        numbers = np.arange(plant.num_positions(), dtype=float)
        self._where = [  # each model's positions among all
            plant.GetPositionsFromArray(model, numbers).astype(int)
            for model in self._models
        ]
        self.DeclareVectorOutputPort(
            name="torque",
            size=plant.num_velocities(self._models[0]),
            calc=self._calc_torque,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def _calc_torque(self, context: Context, output: BasicVector) -> None:
        q = np.zeros(self._plant.num_positions())
        for where, state in zip(self._where, self._states, strict=True):
            q[where] = state.Eval(context)[: len(where)]
        self._plant.SetPositions(self._plant_context, q)
        forces = self._plant.CalcGravityGeneralizedForces(self._plant_context)
        output.SetFromVector(
            -self._plant.GetVelocitiesFromArray(self._models[0], forces)
        )
