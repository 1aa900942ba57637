"""Ports by name, before there is a diagram that exports them."""

import dataclasses as dc

from pydrake.systems.framework import (
    Diagram,
    DiagramBuilder,
    InputPort,
    OutputPort,
)


@dc.dataclass
class Ports:
    """Ports of subsystems under the names that a diagram exports them by.

    A group of systems in a builder is connected by it as a diagram of them would be.
    """

    inputs: dict[str, InputPort] = dc.field(default_factory=dict)
    outputs: dict[str, OutputPort] = dc.field(default_factory=dict)
    # Further input ports, each of which gets what the one of `inputs` by its name gets.
    followers: dict[str, InputPort] = dc.field(default_factory=dict)

    def GetInputPort(self, name: str) -> InputPort:
        """Return an input port, as Drake's systems do."""
        return self.inputs[name]

    def GetOutputPort(self, name: str) -> OutputPort:
        """Return an output port, as Drake's systems do."""
        return self.outputs[name]

    def Export(self, builder: DiagramBuilder) -> None:
        """Export them all, in their order."""
        for name, source in self.inputs.items():
            exported = builder.ExportInput(source, name)
            if name in self.followers:
                builder.ConnectInput(exported, self.followers[name])
        for name, port in self.outputs.items():
            builder.ExportOutput(port, name)


def input_ports(system: Diagram | Ports, name: str) -> list[InputPort]:
    """The input ports of a diagram, or of what stands for one, that a name is for."""
    ports = [system.GetInputPort(name)]
    if isinstance(system, Ports) and name in system.followers:
        ports.append(system.followers[name])
    return ports


def output_ports(system: Diagram | Ports) -> dict[str, OutputPort]:
    """The output ports of a diagram, or of what stands for one, by their names."""
    if isinstance(system, Ports):
        return dict(system.outputs)
    ports = map(system.get_output_port, range(system.num_output_ports()))
    return {port.get_name(): port for port in ports}
