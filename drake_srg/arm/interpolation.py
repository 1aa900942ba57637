"""Linear motion between an arm's commands, without an event in Python."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    LinearSystem,
    Multiplexer,
)

from drake_srg.types import Vector

_TICKS = 10_000  # so many commands are checked to fall on steps


def AddLinearInterpolation(
    builder: DiagramBuilder, start: Vector, command_period: float, period: float
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
        start: Positions at the start, shape (N,).
        command_period: Time between commands [s].
        period: Time between steps of the output [s].

    Raises:
        ValueError: If steps and commands do not fall on the same times. The position is
            a sum of steps, which would drift.
    """
    ratio, ticks = round(command_period / period), np.arange(_TICKS)
    if ratio < 1 or np.any(ticks * command_period != ticks * ratio * period):
        raise ValueError(
            f"arm.command_period: must be a multiple of arm.period ({period}) whose "
            "times are exact in binary, such as multiples of 1/1024, "
            f"got {command_period}"
        )
    inner = DiagramBuilder()
    n = len(start)
    eye = np.eye(n)
    # The last two commands are its state, their difference over the period the speed.
    none = np.zeros((n, n))
    speed = inner.AddNamedSystem(
        "speed",
        LinearSystem(
            A=np.block([[none, none], [eye, none]]),
            B=np.vstack([eye, none]),
            C=np.hstack([eye, -eye]) / command_period,
            D=none,
            time_period=command_period,
        ),
    )
    speed.configure_default_state(np.tile(start, 2))
    inner.ExportInput(speed.get_input_port(), "position")
    position = inner.AddNamedSystem(
        "position",
        LinearSystem(A=eye, B=period * eye, C=eye, D=none, time_period=period),
    )
    position.configure_default_state(start)
    inner.Connect(speed.get_output_port(), position.get_input_port())
    state = inner.AddNamedSystem("state", Multiplexer([n, n]))
    inner.Connect(position.get_output_port(), state.get_input_port(0))
    inner.Connect(speed.get_output_port(), state.get_input_port(1))
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
    for name, state in (("speed", np.tile(position, 2)), ("position", position)):
        system = interpolator.GetSubsystemByName(name)
        system.GetMyMutableContextFromRoot(context).SetDiscreteState(state)
