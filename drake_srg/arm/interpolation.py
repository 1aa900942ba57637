"""Linear motion between an arm's commands, without an event in Python."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    LinearSystem,
    MatrixGain,
    Multiplexer,
    StateInterpolatorWithDiscreteDerivative,
)

from drake_srg.types import Vector


def AddLinearInterpolation(
    builder: DiagramBuilder, num_joints: int, command_period: float, period: float
) -> Diagram:
    """Add `interpolator`, which moves evenly from one position command to the next.

    .. pydrake_system::

        name: Interpolation
        input_ports:
        - position
        output_ports:
        - state

    `position` (N) is sampled every `command_period`. `state` (2N), [q; v], moves within
    the next such period from the last sample but one to the last, in steps of `period`.

    Args:
        builder: Of the diagram.
        num_joints: Number N of joints.
        command_period: Time between commands [s].
        period: Time between steps of the output [s].
    """
    inner = DiagramBuilder()
    n, eye = num_joints, np.eye(num_joints)
    commands = inner.AddNamedSystem(
        "commands",
        StateInterpolatorWithDiscreteDerivative(
            n, command_period, suppress_initial_transient=True
        ),
    )
    speed = inner.AddNamedSystem(
        "speed", MatrixGain(np.hstack([0.0 * eye, eye]))
    )
    inner.Connect(commands.get_output_port(), speed.get_input_port())
    position = inner.AddNamedSystem(
        "position",
        LinearSystem(
            A=eye, B=period * eye, C=eye, D=np.zeros((n, n)), time_period=period
        ),
    )
    inner.Connect(speed.get_output_port(), position.get_input_port())
    state = inner.AddNamedSystem("state", Multiplexer([n, n]))
    inner.Connect(position.get_output_port(), state.get_input_port(0))
    inner.Connect(speed.get_output_port(), state.get_input_port(1))
    inner.ExportInput(commands.get_input_port(), "position")
    inner.ExportOutput(state.get_output_port(), "state")
    return builder.AddNamedSystem("interpolator", inner.Build())


def SetInterpolatedPosition(
    interpolator: Diagram, context: Context, position: Vector
) -> None:
    """Put the output of `AddLinearInterpolation` at rest.

    Args:
        interpolator: The diagram.
        context: A mutable context that contains it.
        position: Of the joints, shape (N,).
    """
    commands = interpolator.GetSubsystemByName("commands")
    commands.set_initial_position(commands.GetMyMutableContextFromRoot(context), position)
    held = interpolator.GetSubsystemByName("position")
    held.GetMyMutableContextFromRoot(context).SetDiscreteState(position)
