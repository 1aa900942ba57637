"""Flat root diagrams for CENIC on Drake before 1.58.

In these versions, CENIC looks for the plant among the root's direct subsystems. So the
systems of our cells and stations are added to the root itself, not to diagrams of their
own. Newer versions accept a nested plant.

`_Root` hides methods of `DiagramBuilder` that are not virtual, which works because only
Python calls them. `_Group` has the methods of `Diagram` that callers use. There is no
simpler way: a system cannot be part of two diagrams, and otherwise every `Add...`
function of a cell would need a second form for a flat root. Once 1.58 is the oldest
supported Drake, delete this file: `MakeRoot` is then `builder = DiagramBuilder()` and
`builder.AddNamedSystem(...)`.
"""

from collections.abc import Callable
from typing import Any, cast

from pydrake.systems.framework import (
    Context,
    Diagram,
    DiagramBuilder,
    InputPort,
    OutputPort,
)

from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.systems import (
    NEWER_DRAKE,
    input_ports,
    output_ports,
    takes_nested_plant,
)
from drake_srg.lifetime import collectable
from drake_srg.scenario.schema import Scenario, is_continuous
from drake_srg.station.station import AddStation

Make = Callable[..., Diagram]
Add = Callable[..., None]


def MakeRoot(
    name: str, make: Make, add: Add | None, scenario: Scenario, origin: str
) -> tuple[DiagramBuilder, Diagram]:
    """Begin a root diagram with a cell or a station in it.

    Args:
        name: Name of the subsystem: the cell or station.
        make: Builds the subsystem from the scenario.
        add: Adds the same systems to a given builder; None if this is not possible.
        scenario: The scenario to build.
        origin: The scenario's name, for error messages.

    Returns:
        The root's builder, and the subsystem.

    Raises:
        ScenarioError: If the installed Drake cannot simulate the scenario.
    """
    if not is_continuous(scenario) or takes_nested_plant():
        builder = DiagramBuilder()
        with scenario_errors(origin):
            return builder, builder.AddNamedSystem(name, make(scenario))
    if add is None:
        raise ScenarioError(
            f"{origin} with a {name} of your own needs {NEWER_DRAKE}, "
            "or plant_config.time_step > 0"
        )
    root = _Root()

    def make_station(scenario: Scenario) -> Diagram:
        return cast(Diagram, root.AddGroup("station", AddStation, scenario))

    with scenario_errors(origin):
        group = root.AddGroup(name, add, scenario, make_station)
    return root, cast(Diagram, group)


class _Root(DiagramBuilder):
    """A builder whose groups of systems have separate exports."""

    def __init__(self) -> None:
        super().__init__()
        collectable(self)
        self._groups: dict[str, _Group] = {}
        self._open: list[_Group] = []  # the groups that are being added
        # Inputs that are exported as one: key of the first one to the others.
        self._together: dict[tuple[str, int], list[InputPort]] = {}

    def AddGroup(self, name: str, add: Add, *arguments: Any) -> "_Group":
        """Call `add` with this builder, and return the exports as a group."""
        group = self._groups[name] = _Group(self.GetSubsystemByName)
        self._open.append(group)
        add(self, *arguments)
        self._open.pop()
        return group

    def AddNamedSystem(self, name: str, system: Any) -> Any:
        """Add a system like Drake; return a group unchanged: it is already added."""
        if isinstance(system, _Group):
            return system
        return super().AddNamedSystem(name=name, system=system)

    def GetSubsystemByName(self, name: str) -> Any:
        """Return a group or, like Drake, a system."""
        return self._groups.get(name) or super().GetSubsystemByName(name)

    def ExportInput(self, input: InputPort, name: str) -> None:
        """Export an input from the innermost open group."""
        self._open[-1].inputs[name] = input

    def ConnectInput(self, name: str, input: InputPort) -> None:
        """Export an input together with one that has already been exported."""
        first = self._open[-1].inputs[name]
        self._together.setdefault(_key(first), []).append(input)

    def ExportOutput(self, output: OutputPort, name: str) -> None:
        """Export an output from the innermost open group."""
        self._open[-1].outputs[name] = output

    def Connect(self, output: OutputPort, input: InputPort) -> None:
        """Connect to an input, and to all inputs that are exported together with it."""
        for port in (input, *self._together.get(_key(input), ())):
            super().Connect(output, port)

    def Build(self) -> Diagram:
        """Build the root, which exports the ports of its outermost group."""
        # The diagram keeps this builder alive, and groups keep the diagram alive. So
        # the builder must not keep the groups, or nothing would ever be freed.
        (_, outermost), *nested = self._groups.items()
        together, self._groups, self._together = self._together, {}, {}
        for name, port in outermost.inputs.items():
            super().ExportInput(port, name)
            for other in together.get(_key(port), ()):
                super().ConnectInput(name, other)
        for name, output in outermost.outputs.items():
            super().ExportOutput(output, name)
        diagram = super().Build()
        inner = dict(nested)
        for group in (outermost, *inner.values()):
            group.diagram = diagram
            group.GetSubsystemByName = diagram.GetSubsystemByName
        outermost.GetSubsystemByName = lambda name: (
            inner.get(name) or diagram.GetSubsystemByName(name)
        )
        return diagram


def _key(port: InputPort) -> tuple[str, int]:
    """Return a key that identifies a port within a builder."""
    return port.get_system().get_name(), int(port.get_index())


class _Group:
    """Systems in the root that stand in for a diagram of their own."""

    def __init__(self, find: Callable[[str], Any]) -> None:
        self.GetSubsystemByName = find
        self.inputs: dict[str, InputPort] = {}
        self.outputs: dict[str, OutputPort] = {}
        self.diagram: Diagram | None = None  # the root, once it is built

    def HasInputPort(self, name: str) -> bool:
        """Return whether the group exports an input of this name."""
        return name in self.inputs

    def HasOutputPort(self, name: str) -> bool:
        """Return whether the group exports an output of this name."""
        return name in self.outputs

    def GetInputPort(self, name: str) -> InputPort:
        """Return an exported input; once the root is built, it is the root's."""
        return (
            self.inputs[name]
            if self.diagram is None
            else self.diagram.GetInputPort(name)
        )

    def GetOutputPort(self, name: str) -> OutputPort:
        """Return an exported output; once the root is built, it is the root's."""
        return (
            self.outputs[name]
            if self.diagram is None
            else self.diagram.GetOutputPort(name)
        )

    def ValidateContext(self, context: Context) -> None:
        """Accept the root's context, which serves as the group's."""
        assert self.diagram is not None
        self.diagram.ValidateContext(context)


@input_ports.register
def _(system: _Group) -> dict[str, InputPort]:
    return {name: system.GetInputPort(name) for name in system.inputs}


@output_ports.register
def _(system: _Group) -> dict[str, OutputPort]:
    return {name: system.GetOutputPort(name) for name in system.outputs}
