"""A DiagramBuilder that runs all stages added to it as one system."""

from __future__ import annotations

from typing import Any, cast

from pydrake.systems.framework import (
    Diagram,
    DiagramBuilder,
    InputPort,
    OutputPort,
    System,
)

from drake_srg.common.fused import FusedStages, StagePort
from drake_srg.common.stages import Stage
from drake_srg.lifetime import collectable

# Name of the system that runs the stages.
FUSED = "fused_stages"


class FusingBuilder(DiagramBuilder):
    """Builds the diagram that a DiagramBuilder would, with its stages fused.

    The diagram has the same ports and gives the same values. Systems that are not
    stages stay as they are, connected to the one that runs the stages. Inputs are
    exported by name, without an index.
    """

    def __init__(self) -> None:
        super().__init__()
        collectable(self)
        self._stages: dict[str, Stage] = {}
        # All connections so far: from an output port or the name of an exported input
        # to an input port or the name of an exported output.
        self._arrows: list[tuple[OutputPort | str, InputPort | str]] = []

    def AddNamedSystem(self, name: str, system: Any) -> Any:
        """Add a system as Drake does, or keep a stage for `Build`."""
        if isinstance(system, Stage):
            self._stages[name] = system
            cast(System, system).set_name(name)
            return system
        return super().AddNamedSystem(name=name, system=system)

    def Connect(self, output: OutputPort, input: InputPort) -> None:
        """Connect an output to an input."""
        self._arrows.append((output, input))

    def ExportInput(self, input: InputPort, name: str) -> None:
        """Export an input."""
        self._arrows.append((name, input))

    def ConnectInput(self, name: str, input: InputPort) -> None:
        """Connect an input to one that is exported already."""
        self._arrows.append((name, input))

    def ExportOutput(self, output: OutputPort, name: str) -> None:
        """Export an output."""
        self._arrows.append((output, name))

    def Build(self) -> Diagram:
        """Build the diagram."""
        arrows, self._arrows = self._arrows, []
        wires: dict[StagePort, StagePort | str] = {}
        outputs: dict[str, StagePort] = {}
        for source, target in arrows:
            start, end = self._find(source), self._find(target)
            if end is not None:
                wires[end] = start or _name(source)
            elif start is not None:
                outputs[_name(source)] = start
        if self._stages:
            fused = super().AddNamedSystem(
                name=FUSED, system=FusedStages(self._stages, wires, outputs)
            )
        outer = dict.fromkeys(
            (
                fused.GetOutputPort(_name(source)) if self._find(source) else source,
                fused.GetInputPort(_name(source)) if self._find(target) else target,
            )
            for source, target in arrows
            if not (self._find(source) and self._find(target))
        )
        exported = set()
        for source, target in outer:
            if isinstance(target, str):
                super().ExportOutput(source, target)
            elif not isinstance(source, str):
                super().Connect(source, target)
            elif source in exported:
                super().ConnectInput(source, target)
            else:
                super().ExportInput(target, source)
                exported.add(source)
        return super().Build()

    def _find(self, port: InputPort | OutputPort | str) -> StagePort | None:
        """Return a port as that of a stage; None if it is not."""
        if isinstance(port, str):
            return None
        name = port.get_system().get_name()
        return StagePort(name, port.get_name()) if name in self._stages else None


def _name(port: InputPort | OutputPort | str) -> str:
    """Return the name of the port of `FusedStages` that stands for a port."""
    if isinstance(port, str):
        return port
    return f"{port.get_system().get_name()}.{port.get_name()}"
