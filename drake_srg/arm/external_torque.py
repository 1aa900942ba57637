"""External joint torques: computed from contacts, or estimated."""

from __future__ import annotations

import copy
import math
from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce, SpatialVelocity
from pydrake.multibody.plant import (
    ContactResults,
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
)
from pydrake.multibody.tree import (
    BodyIndex,
    JacobianWrtVariable,
    ModelInstanceIndex,
    MultibodyForces,
    RigidBody,
)
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    OutputPort,
)

from drake_srg.common.contacts import each_contact
from drake_srg.common.joint_errors import ArmErrorsConfig, TorqueErrors
from drake_srg.common.systems import AddUnique
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector

# Time constant of the estimate [s]. At the arm's top speed, contact forces build up
# within 20 to 50 ms.
TIME_CONSTANT = 0.02


class LaggedTorque(LeafSystem):
    """Base class of systems whose output `external_torque` lags behind samples.

    The output (N) is in N m. A subclass declares its input ports, calls
    `_declare_torque`, and implements `_sample`.

    Args:
        period: Period of the samples [s].
    """

    def __init__(self, period: float) -> None:
        super().__init__()
        self._period = period
        self._share = lag_share(period)

    def _declare_torque(self, n: int, num_kept: int) -> None:
        """Declare the output of N = `n` torques, and the samples.

        Args:
            n: Number of joints.
            num_kept: Number of values that a sample keeps for the next one. They are
                NaN until the first sample.
        """
        self._num_kept = num_kept
        state = self.DeclareDiscreteState(
            np.concatenate([np.full(num_kept, np.nan), np.zeros(n)])
        )
        self.DeclareVectorOutputPort(
            name="external_torque",
            size=n,
            calc=self._calc_external_torque,
            prerequisites_of_calc={self.discrete_state_ticket(state)},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=self._period, offset_sec=0.0, update=self._update
        )

    def _sample(self, context: Context, kept: Vector) -> tuple[Vector | None, Vector]:
        """Return the present torque, shape (N,) [N m], or None, and values to keep."""
        raise NotImplementedError

    def _calc_external_torque(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state(0).value()[self._num_kept :])

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        state = context.get_discrete_state(0).value()
        kept, torque = state[: self._num_kept], state[self._num_kept :]
        felt, kept = self._sample(context, kept)
        if felt is not None:
            torque = torque + self._share * (felt - torque)
        discrete_state.set_value(np.concatenate([kept, torque]))


def lag_share(period: float) -> float:
    """Return the share of a jump that a first-order lag covers in a period [s]."""
    return float(-np.expm1(-period / TIME_CONSTANT))


_ZERO = np.zeros(3)


class ContactTorques(LaggedTorque):
    """Computes the joint torques caused by contact and by a held load.

    .. pydrake_system::

        name: ContactTorques
        input_ports:
        - arm_state
        - contact_results
        - body_poses
        - body_spatial_velocities
        - applied_forces (optional)
        output_ports:
        - external_torque

    Contact forces F on links with Jacobians J cause the torques J' F. But a hand holds
    its load by large forces that nearly cancel. Because regularized friction creeps,
    the forces that a plant reports are out of balance by several times the weight of
    the load. So this system treats the hand and its load, the free bodies that it
    touches, as one body, and ignores the forces between them. By Newton's law, the
    force on both is

        F = all other forces on them + weight of the load - dh/dt,

    where h is the momentum of the load, and dh/dt its change between samples. A
    standing can that is only touched adds nothing. A hanging can adds its weight. A can
    pressed on the table adds the force of the press, minus its weight. A can that is
    hit adds the force that sets it in motion. All spatial vectors are [torque; force]
    in world, about the world's origin.

    Stiff bodies may touch for less than a period. An object that drops by half a
    millimetre may press with a hundred times its weight in one sample, but its momentum
    changes much less between samples. So each joint feels only that part of the forces
    on the load, weight included, that lasts from one sample to the next (minmod).

    The inputs are outputs of the plant. `arm_state` (2N) is [q; v], and
    `applied_forces` are the spatial forces applied to the plant. `external_torque` (N)
    [N m], in the order of the arm's velocities, follows with a first-order lag. All are
    sampled every `period`.

    Args:
        plant: The finalized plant, with geometry.
        arm: The arm whose torques are computed.
        gripper: The hand, which moves with the arm.
        models_plant: A finalized plant with arm and gripper, by the same names, and no
            other moving body.
        period: Time between samples [s].
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        arm: ModelInstanceIndex,
        gripper: ModelInstanceIndex | None,
        models_plant: MultibodyPlant,
        period: float,
    ) -> None:
        super().__init__(period)
        self._plant = models_plant
        self._plant_context = models_plant.CreateDefaultContext()  # scratch, not state
        self._arm = models_plant.GetModelInstanceByName(plant.GetModelInstanceName(arm))
        self._gravity = np.array(plant.gravity_field().gravity_vector())

        # Numbers of bodies and geometries instead of ids, which would keep the plant
        # alive.
        links, fingers = (
            [] if model is None else _bodies(plant, model) for model in (arm, gripper)
        )
        # Rows of wrenches: one per link, then the hand, then the load.
        self._hand, self._load = len(links), len(links) + 1
        self._link_of = {int(link.index()): i for i, link in enumerate(links)}
        self._link_of |= {int(finger.index()): self._hand for finger in fingers}
        # A wrench on a finger counts as one on the hand, because the arm's joints do
        # not move fingers relative to it.
        self._frames = [
            models_plant.GetFrameByName(
                body.name(),
                models_plant.GetModelInstanceByName(
                    plant.GetModelInstanceName(body.model_instance())
                ),
            )
            for body in (*links, *2 * (fingers or links)[:1])
        ]
        free = _free_bodies(plant, {arm, gripper})
        # Copies: the plant's own inertias would keep its diagram alive.
        self._inertias = {
            int(body.index()): copy.copy(body.default_spatial_inertia())
            for body in free
        }
        self._body_of = {
            geometry.get_value(): int(body.index())
            for body in (*links, *fingers, *free)
            for geometry in plant.GetCollisionGeometriesForBody(body)
        }

        self._world = models_plant.world_frame()
        n, n_all = models_plant.num_velocities(self._arm), models_plant.num_velocities()
        # Indices of the arm's velocities among those of all joints.
        columns = models_plant.GetVelocitiesFromArray(
            self._arm, np.arange(float(n_all))
        )
        self._columns = columns.astype(int)
        self._state = self.DeclareVectorInputPort(
            name="arm_state", size=models_plant.num_multibody_states(self._arm)
        )
        self._contacts, self._poses, self._velocities, self._applied = (
            self.DeclareAbstractInputPort(name, AbstractValue.Make(model))
            for name, model in (
                ("contact_results", ContactResults()),
                ("body_poses", [RigidTransform()]),
                ("body_spatial_velocities", [SpatialVelocity()]),
                ("applied_forces", [ExternallyAppliedSpatialForce()]),
            )
        )
        # Values kept: h of each free body, and the torque of the load's forces.
        self._declare_torque(n, num_kept=6 * len(free) + n)

    def _sample(self, context: Context, kept: Vector) -> tuple[Vector, Vector]:
        load_last = np.nan_to_num(kept[6 * len(self._inertias) :])
        poses, velocities = self._poses.Eval(context), self._velocities.Eval(context)
        wrenches, touched = self._wrenches(context, poses)
        h = np.empty((len(self._inertias), 6))
        for i, (body, M_BBo_B) in enumerate(self._inertias.items()):
            X_WB = poses[body]
            p_BWo_W = -X_WB.translation()
            M_BBo_W = M_BBo_B.ReExpress(X_WB.rotation())
            h[i] = (M_BBo_W * velocities[body]).Shift(p_BWo_W).get_coeffs()
            if body in touched:
                weight = SpatialForce(_ZERO, M_BBo_W.get_mass() * self._gravity)
                p_BcmWo_W = p_BWo_W - M_BBo_W.get_com()
                wrenches[self._load] += weight.Shift(p_BcmWo_W).get_coeffs()
                h_last = kept[6 * i : 6 * i + 6]
                if not math.isnan(h_last[0]):
                    wrenches[self._hand] -= (h[i] - h_last) / self._period
        felt, load = self._joint_torques(self._state.Eval(context), wrenches)
        felt += _minmod(load, load_last)
        return felt, np.concatenate([h.ravel(), load])

    def _wrenches(
        self, context: Context, poses: list[RigidTransform]
    ) -> tuple[dict[int, Vector], set[int]]:
        """Return the wrenches on links, hand and load, and the bodies of the load."""
        body_of = self._body_of
        contacts = [
            (body_of.get(contact.id_A, -1), body_of.get(contact.id_B, -1), contact)
            for contact in each_contact(self._contacts.Eval(context))
        ]
        touched = {
            body
            for a, b, _ in contacts
            for body, other in ((a, b), (b, a))
            if body in self._inertias and self._link_of.get(other) == self._hand
        }
        link_of = self._link_of | dict.fromkeys(touched, self._load)
        wrenches: dict[int, Vector] = defaultdict(lambda: np.zeros(6))
        for a, b, contact in contacts:
            link_A, link_B = link_of.get(a, -1), link_of.get(b, -1)
            if link_A == link_B or min(link_A, link_B) >= self._hand:
                continue  # neither body counts, or the contact is inside hand and load
            F_AWo_W = contact.F_Ac_W().Shift(-contact.p_WC()).get_coeffs()
            if link_A >= 0:
                wrenches[link_A] += F_AWo_W
            if link_B >= 0:
                wrenches[link_B] -= F_AWo_W
        if self._applied.HasValue(context):
            for applied in self._applied.Eval(context):
                body = int(applied.body_index)
                if body in link_of:
                    p_WQ = poses[body] @ applied.p_BoBq_B
                    F_BWo_W = applied.F_Bq_W.Shift(-p_WQ).get_coeffs()
                    wrenches[link_of[body]] += F_BWo_W
        return wrenches, touched

    def _joint_torques(
        self, arm_state: Vector, wrenches: dict[int, Vector]
    ) -> tuple[Vector, Vector]:
        """Return the torques due to links and hand, and due to the load, (N,) [N m]."""
        plant, context, world = self._plant, self._plant_context, self._world
        felt, load = np.zeros(len(self._columns)), np.zeros(len(self._columns))
        if wrenches:
            q = arm_state[: plant.num_positions(self._arm)]
            plant.SetPositions(context, self._arm, q)
        for link, wrench in wrenches.items():
            frame = self._frames[link]
            p_LWo = frame.CalcPoseInWorld(context).inverse().translation()
            J = plant.CalcJacobianSpatialVelocity(
                context, JacobianWrtVariable.kV, frame, p_LWo, world, world
            )
            target = load if link == self._load else felt
            target += wrench @ J[:, self._columns]
        return felt, load


def _minmod(a: Vector, b: Vector) -> Vector:
    """Return the entries of smaller size where both signs are equal, else 0."""
    return np.minimum(np.maximum(a, np.minimum(b, 0.0)), np.maximum(b, 0.0))


def _bodies(plant: MultibodyPlant, model: ModelInstanceIndex) -> list[RigidBody]:
    return [plant.get_body(index) for index in plant.GetBodyIndices(model)]


def _free_bodies(
    plant: MultibodyPlant, others: set[ModelInstanceIndex | None]
) -> list[RigidBody]:
    """Return the free bodies without joints that belong to other models."""
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    parents = {joint.parent_body().index() for joint in joints}
    bodies = [plant.get_body(BodyIndex(i)) for i in range(plant.num_bodies())]
    return [
        body
        for body in bodies
        if body.is_floating_base_body()
        and body.model_instance() not in others
        and body.index() not in parents
    ]


class ExternalTorqueObserver(LaggedTorque):
    """Estimates the joint torques caused by contact and by a held load.

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

    and needs no accelerations, only the change of the momentum p = M v. Between two
    samples, this change, apart from that of M itself, is M (v - v_last). So here

        tau_external = M (v - v_last) / period + C v - g - tau,

    where g includes the damping of the joints, and tau is the motors' torque between
    the samples.

    The inputs are the states [q; v] of the model instances `models`, in the order of
    the plant's state output ports, and `torque` (N) [N m], the motors' torque of the
    first model. `external_torque` (N) [N m] is that of the first model, in the order of
    its velocities. All are sampled every `period`. The period should be the plant's own
    step: otherwise, the torque of one sample would stand for several steps.

    Args:
        plant: A finalized plant with these models and no other moving body.
        models: Names of the model instances, the arm's first.
        period: Time between samples [s].
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        models: Sequence[str],
        period: float,
    ) -> None:
        super().__init__(period)
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
    prefix: str = "",
) -> OutputPort:
    """Add a system that estimates an arm's external torques; return its port.

    A discrete plant gets an `ExternalTorqueObserver` with the plant's step. It reads
    what the arm's own controller measures at the joints, torques and motion, but
    without errors. In a continuous plant, the torque of stiff actuators is a saw tooth
    between samples, of height v kp period, 170 N m at an iiwa's top speed, so no sample
    represents its mean. Such a plant gets `ContactTorques` instead, with the same lag.
    It computes what joint torque sensors inside an arm would measure.

    If spatial forces are applied to arm, hand or load in the plant, the caller connects
    the same forces to `contact_torques`, if that exists.

    Args:
        builder: Builder of the diagram.
        plant: Plant with the arm, finalized and in the diagram.
        arm: Its model instance.
        gripper: The model instance that the arm carries, if any.
        models_plant: A finalized plant with both and no other moving body.
        period: Time between draws of the sensors' noise, and between readings of a
            continuous plant's contacts [s].
        errors: Errors of the torque sensors.
        seed: Seed of the noise.
        prefix: Prefix of the systems' names in the diagram.

    Returns:
        The port of the external torques (N) [N m].
    """
    port = _external_torque(builder, plant, arm, gripper, models_plant, period, prefix)
    if errors is None or errors.torque_offset == errors.torque_noise == 0.0:
        return port
    limits = [
        actuator.effort_limit()
        for actuator in map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
        if actuator.model_instance() == arm
    ]
    sensors = AddUnique(
        builder,
        f"{prefix}torque_sensors",
        TorqueErrors(np.array(limits), errors, period, seed),
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
    prefix: str,
) -> OutputPort:
    if not plant.time_step():
        torques = AddUnique(
            builder,
            f"{prefix}contact_torques",
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
    observer = AddUnique(
        builder,
        f"{prefix}external_torque_observer",
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
