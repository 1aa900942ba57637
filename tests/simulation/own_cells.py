"""Cells of one's own for tests of runs."""

from pydrake.systems.framework import DiagramBuilder, EventStatus

from drake_srg.lifetime import LeafSystem
from drake_srg.station import MakeCell


class RaisingPort(LeafSystem):
    """Has an output port that raises an exception from a time on."""

    def __init__(self, error, time):
        super().__init__()
        self._error, self._time = error, time
        self.DeclareVectorOutputPort(name="fuse", size=1, calc=self._calc)

    def _calc(self, context, output):
        if context.get_time() >= self._time - 1e-9:
            raise self._error
        output.SetAtIndex(0, 1.0)


class RaisingStep(LeafSystem):
    """Raises an exception in the first step after a time."""

    def __init__(self, error, time):
        super().__init__()
        self._error, self._time = error, time
        self.DeclarePerStepPublishEvent(self._publish)

    def _publish(self, context):
        if context.get_time() > self._time:
            raise self._error
        return EventStatus.Succeeded()


def cell_with(system=None, leave_out=()):
    """Return a `make_cell` for `Simulate`: a cell with a system beside it.

    Args:
        system: Its output ports are exported as `gripper.NAME`, which are logged.
        leave_out: Names of the cell's output ports that are not exported.
    """

    def make_cell(scenario):
        builder = DiagramBuilder()
        cell = builder.AddNamedSystem("inner", MakeCell(scenario))
        for i in range(cell.num_output_ports()):
            port = cell.get_output_port(i)
            if port.get_name() not in leave_out:
                builder.ExportOutput(port, port.get_name())
        if system is not None:
            builder.AddSystem(system)
            for i in range(system.num_output_ports()):
                port = system.get_output_port(i)
                builder.ExportOutput(port, f"gripper.{port.get_name()}")
        return builder.Build()

    return make_cell
