"""Helpers for Drake's diagrams: versions, simulators, ports and actuators.

Each function that depends on Drake's version names the version that changed the answer.
Delete it once that version is the oldest supported.

CENIC takes the velocities of `desired_state` with the opposite sign, both in Drake
1.51.1 and in 1.58. A joint then lags by 2 kd / kp times its speed.
`AddVelocityFeedforward` sends the velocity's share to `actuation` instead, which works
the same with every integrator. tests/common/test_systems_velocity_feedforward.py fails
once Drake has changed this.
"""

from __future__ import annotations

import functools
import importlib.metadata
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    Joint,
    JointActuator,
    ModelInstanceIndex,
    PrismaticJoint,
)
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import (
    Context,
    Diagram,
    DiagramBuilder,
    EventStatus,
    InputPort,
    OutputPort,
    System,
)
from pydrake.systems.primitives import MatrixGain

from drake_srg.types import Vector

SystemT = TypeVar("SystemT", bound=System)

# The first version found to behave differently from 1.51.1, and its requirement.
NEWER_DRAKE = "drake >= 1.58 (Python 3.12+)"
_NEWER = (1, 58)


def takes_nested_plant() -> bool:
    """Return whether CENIC finds a plant in a nested diagram (since 1.58)."""
    return _version() >= _NEWER


def takes_loop_constraints() -> bool:
    """Return whether CENIC takes ball, distance and weld constraints (since 1.58)."""
    return _version() >= _NEWER


def marks_fixed_steps() -> bool:
    """Return whether CENIC's fixed steps invalidate cached values (since 1.58)."""
    return _version() >= _NEWER


def has_fast_contact() -> bool:
    """Return whether steps with contact take a quarter less time (since 1.58)."""
    return _version() >= _NEWER


def contact_approximations() -> list[str]:
    """Return the names of the discrete contact approximations (no tamsi since 1.58)."""
    from pydrake.multibody.plant import DiscreteContactApproximation

    members = DiscreteContactApproximation.__members__
    return sorted(name.removeprefix("k").lower() for name in members)


def _version() -> tuple[int, ...]:
    """Return the major and minor version."""
    numbers = importlib.metadata.version("drake").split(".")
    return tuple(int(number) for number in numbers[:2])


def MakeSimulator(diagram: Diagram, config: SimulatorConfig) -> Simulator:
    """Return a simulator of a diagram.

    With fixed steps, CENIC before Drake 1.58 does not invalidate the cache after a
    step: poses, distances and contacts would be one step old. A monitor does it here.
    """
    simulator = Simulator(diagram)
    ApplySimulatorConfig(config, simulator)
    fixed = config.integration_scheme == "cenic" and not config.use_error_control
    if fixed and not marks_fixed_steps():
        simulator.set_monitor(_mark_outdated)
    return simulator


def _mark_outdated(root: Context) -> EventStatus:
    root.get_mutable_continuous_state_vector()
    return EventStatus.DidNothing()


@functools.singledispatch
def input_ports(system: System) -> dict[str, InputPort]:
    """Return the input ports of a system by name, in their order."""
    ports = map(system.get_input_port, range(system.num_input_ports()))
    return {port.get_name(): port for port in ports}


@functools.singledispatch
def output_ports(system: System) -> dict[str, OutputPort]:
    """Return the output ports of a system by name, in their order."""
    ports = map(system.get_output_port, range(system.num_output_ports()))
    return {port.get_name(): port for port in ports}


def value_or_none(port: InputPort, context: Context) -> Vector | None:
    """Return the vector at an optional input port, or None."""
    return port.Eval(context) if port.HasValue(context) else None


def AddUnique(builder: DiagramBuilder, name: str, system: SystemT) -> SystemT:
    """Add a system to a diagram under a unique name.

    With a duplicate name, Drake would end the process when the diagram is built.

    Raises:
        ValueError: If the name is taken.
    """
    if builder.HasSubsystemNamed(name):
        raise ValueError(
            f"{name}: the diagram already has a system of this name (allowed: another "
            "`name`)"
        )
    added: SystemT = builder.AddNamedSystem(name, system)
    return added


def check_prepared(plant: MultibodyPlant, model: ModelInstanceIndex) -> None:
    """Check that a model's actuators have the gains of PD controllers.

    Raises:
        ValueError: If an actuator lacks gains.
    """
    for actuator in model_actuators(plant, model):
        if not actuator.has_controller():
            name = plant.GetModelInstanceName(model)
            raise ValueError(
                f"{name}: actuator {actuator.name()} has no gains: call the "
                "configuration's prepare_plant before the plant is finalized"
            )


def export_outputs(builder: DiagramBuilder, system: System) -> None:
    """Export all output ports of a subsystem under their own names."""
    for name, port in output_ports(system).items():
        builder.ExportOutput(port, name)


def model_actuators(
    plant: MultibodyPlant, model: ModelInstanceIndex
) -> list[JointActuator]:
    """Return the actuators of a model instance in the plant's order."""
    actuators = [plant.get_joint_actuator(a) for a in plant.GetJointActuatorIndices()]
    return [a for a in actuators if a.model_instance() == model]


def moving_joints(plant: MultibodyPlant, model: ModelInstanceIndex) -> list[Joint]:
    """Return a model's joints with one position, in the order of their positions."""
    joints = map(plant.get_joint, plant.GetJointIndices(model))
    moving = (joint for joint in joints if joint.num_positions() == 1)
    return sorted(moving, key=lambda joint: joint.position_start())


def joint_unit(joint: Joint) -> str:
    """Return the unit of a joint's position: m if it slides, otherwise rad."""
    return "m" if joint.type_name() == PrismaticJoint.kTypeName else "rad"


def joint_to_actuator(
    plant: MultibodyPlant, model: ModelInstanceIndex, names: Sequence[str]
) -> Vector:
    """Return the matrix that puts torques of n joints into the actuators' order.

    Args:
        plant: The plant.
        model: Model instance of the actuators.
        names: Names of the joints, in the order of the torques.
    """
    joints = [a.joint().name() for a in model_actuators(plant, model)]
    return np.array([[float(name == joint) for name in names] for joint in joints])


def AddVelocityFeedforward(
    builder: DiagramBuilder, desired: OutputPort, kd: Vector, name: str = ""
) -> tuple[OutputPort, OutputPort]:
    """Split a desired state into a desired position and a torque.

    The plant's PD actuators then make kp (q_d - q) - kd v + kd v_d, as with the desired
    state itself, and keep their effort limits.

    Args:
        builder: Builder of the diagram that has `desired`.
        desired: Desired state [q; v] (2N).
        kd: Damping of the actuators (N) [N m s / rad or N s / m].
        name: Prefix of the systems' names.

    Returns:
        [q; 0] (2N), for the plant's `desired_state`, and kd v (N) [N m or N], for its
        `actuation`.
    """
    n = len(kd)
    zero = np.zeros((n, n))
    position = builder.AddNamedSystem(
        f"{name}desired_position", MatrixGain(np.diag([*np.ones(n), *np.zeros(n)]))
    )
    torque = builder.AddNamedSystem(
        f"{name}velocity_feedforward", MatrixGain(np.hstack([zero, np.diag(kd)]))
    )
    for system in (position, torque):
        builder.Connect(desired, system.get_input_port())
    return position.get_output_port(), torque.get_output_port()
