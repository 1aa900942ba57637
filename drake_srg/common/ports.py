"""Access to a system's ports by name."""

import functools

from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    InputPort,
    OutputPort,
    System,
)

from drake_srg.types import Vector


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
    """Return the vector at an optional input port; None while it has none."""
    return port.Eval(context) if port.HasValue(context) else None


def export_outputs(builder: DiagramBuilder, system: System) -> None:
    """Export all output ports of a subsystem under their own names."""
    for name, port in output_ports(system).items():
        builder.ExportOutput(port, name)
