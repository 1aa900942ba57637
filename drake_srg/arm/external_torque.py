"""External torques of an arm, from the torques and the motion of its joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, MultibodyForces
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    OutputPort,
)

from drake_srg.arm.contact_torques import ContactTorques
from drake_srg.arm.lag import TIME_CONSTANT, LaggedTorque
from drake_srg.common.joint_errors import ArmErrorsConfig, TorqueErrors
from drake_srg.types import Vector


class ExternalTorqueObserver(LaggedTorque):
    """Estimates the joint torques that touch and a held load cause.

    .. pydrake_system::

        name: ExternalTorqueObserver
        input_ports:
        - MODEL_state (each model)
        - torque
        output_ports:
        - external_torque

    This is the generalized-momentum observer of A. De Luca and R. Mattone (ICRA 2003,
    2005; S. Haddadin, A. De Luca, A. Albu-Schaeffer, Robot Collisions: A Survey, IEEE
    Trans. Robotics 33(6), 2017). Its residual r follows the external torque with a lag,

        r' = (tau_external - r) / time_constant,

    and needs no accelerations, only the gain of the momentum p = M v. Between two
    samples, that gain, less the one of M itself, is M (v - v_last). So here

        tau_external = M (v - v_last) / period + C v - g - tau,

    where g includes the damping of the joints, and tau is what the motors applied from
    one sample to the next.

    The inputs are the states [q; v] of the model instances `models`, in the order of
    the plant's state output ports, and `torque` (N) [N m], what the motors of the first
    model apply. `external_torque` (N) [N m] belongs to the first model, in the order of
    its velocities. All are sampled every `period`. It should be the plant's own step,
    because the torque of one sample does not stand for all steps between two samples.

    Args:
        plant: A finalized plant with these models and no other moving body.
        models: Names of the model instances, the arm's first.
        period: [s].
        time_constant: Of the estimate [s].
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        models: Sequence[str],
        period: float,
        time_constant: float = TIME_CONSTANT,
    ) -> None:
        super().__init__(period, time_constant)
        self._plant = plant
        self._plant_context = plant.CreateDefaultContext()  # scratch, not state
        self._forces = MultibodyForces(plant)
        self._models = [plant.GetModelInstanceByName(name) for name in models]
        for name, model in zip(models, self._models, strict=True):
            self.DeclareVectorInputPort(
                name=f"{name}_state", size=plant.num_multibody_states(model)
            )
        n, n_all = plant.num_velocities(self._models[0]), plant.num_velocities()
        self._torque = self.DeclareVectorInputPort(name="torque", size=n)
        self._declare_torque(n, num_kept=n_all)  # v of all models

    def _sample(self, context: Context, v_last: Vector) -> tuple[Vector | None, Vector]:
        plant, scratch = self._plant, self._plant_context
        for i, model in enumerate(self._models):
            plant.SetPositionsAndVelocities(
                scratch, model, self.get_input_port(i).Eval(context)
            )
        v = plant.GetVelocities(scratch)
        if np.isnan(v_last[0]):
            return None, v
        plant.CalcForceElementsContribution(scratch, self._forces)
        needed = plant.CalcInverseDynamics(
            scratch, (v - v_last) / self._period, self._forces
        )
        needed = plant.GetVelocitiesFromArray(self._models[0], needed)
        return needed - self._torque.Eval(context), v


def AddExternalTorque(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    arm: ModelInstanceIndex,
    gripper: ModelInstanceIndex | None,
    models_plant: MultibodyPlant,
    period: float,
    errors: ArmErrorsConfig | None = None,
    seed: int = 0,
) -> OutputPort:
    """Add a system that estimates an arm's external torques; return its port.

    A plant with steps gets an `ExternalTorqueObserver` with the same step. It reads
    what the arm's own controller reads: torques and motion at the joints, without the
    errors of its reports. Between samples of a continuous plant, the torque of stiff
    actuators is a saw tooth of height v kp period, 170 N m at an iiwa's top speed, and
    no sample stands for its mean. Such a plant gets `ContactTorques` instead, with the
    same lag. Joint torque sensors inside an arm would tell as much.

    If the plant has applied spatial forces on arm, hand or load, the caller connects
    the same forces to `contact_torques`, if that exists.

    Args:
        builder: Of the diagram.
        plant: With the arm, finalized and in the diagram.
        arm: Its model instance.
        gripper: The model instance that it carries, if any.
        models_plant: A finalized plant with both and no other moving body.
        period: Time between readings of torque sensors with errors, and of a continuous
            plant's contacts [s].
        errors: Of the torque sensors.
        seed: Of their noise.

    Returns:
        The port of the external torques (N) [N m].
    """
    port = _external_torque(builder, plant, arm, gripper, models_plant, period)
    if errors is None or errors.torque_offset == errors.torque_noise == 0.0:
        return port
    limits = [
        actuator.effort_limit()
        for actuator in map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
        if actuator.model_instance() == arm
    ]
    sensors = builder.AddNamedSystem(
        "torque_sensors", TorqueErrors(np.array(limits), errors, period, seed)
    )
    builder.Connect(port, sensors.get_input_port())
    return sensors.get_output_port()


def _external_torque(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    arm: ModelInstanceIndex,
    gripper: ModelInstanceIndex | None,
    models_plant: MultibodyPlant,
    period: float,
) -> OutputPort:
    if not plant.time_step():
        torques = builder.AddNamedSystem(
            "contact_torques",
            ContactTorques(plant, arm, gripper, models_plant, period),
        )
        for source, name in (
            (plant.get_state_output_port(arm), "arm_state"),
            (plant.get_contact_results_output_port(), "contact_results"),
            (plant.get_body_poses_output_port(), "body_poses"),
            (
                plant.get_body_spatial_velocities_output_port(),
                "body_spatial_velocities",
            ),
        ):
            builder.Connect(source, torques.GetInputPort(name))
        return torques.get_output_port()
    instances = [arm] if gripper is None else [arm, gripper]
    observer = builder.AddNamedSystem(
        "external_torque_observer",
        ExternalTorqueObserver(
            models_plant,
            [plant.GetModelInstanceName(i) for i in instances],
            plant.time_step(),
        ),
    )
    for i, instance in enumerate(instances):
        builder.Connect(
            plant.get_state_output_port(instance), observer.get_input_port(i)
        )
    builder.Connect(
        plant.get_net_actuation_output_port(arm), observer.GetInputPort("torque")
    )
    return observer.get_output_port()
