"""A cell whose localizer is off by a known error."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable

from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from drake_srg.common.systems import export_outputs
from drake_srg.lifetime import LeafSystem
from drake_srg.scenario import Scenario
from drake_srg.station import ConnectPlanner, MakePlanner, MakeStation
from drake_srg.station.perception import AddLocalizer
from drake_srg.types import Blob, Vector


class SightingError(LeafSystem):
    """Shifts all sightings by a constant error.

    .. pydrake_system::

        name: SightingError
        input_ports:
        - blobs_seen
        output_ports:
        - blobs

    Args:
        offset: Added to the position of every blob, shape (3,) [m].
    """

    def __init__(self, offset: Vector) -> None:
        super().__init__()
        self._X_error = RigidTransform(offset)
        nothing: list[Blob] = []
        self._seen = self.DeclareAbstractInputPort(
            "blobs_seen", AbstractValue.Make(nothing)
        )
        self.DeclareAbstractOutputPort(
            "blobs", lambda: AbstractValue.Make(nothing), self._calc_blobs
        )

    def _calc_blobs(self, context: Context, output: AbstractValue) -> None:
        seen: list[Blob] = self._seen.Eval(context)
        output.set_value(
            [dc.replace(blob, X_WO=self._X_error @ blob.X_WO) for blob in seen]
        )


def cell_maker(offset: Vector) -> Callable[[Scenario], Diagram]:
    """Return a function that makes a cell with sightings off by `offset` (3,) [m]."""

    def make_cell(scenario: Scenario) -> Diagram:
        builder = DiagramBuilder()
        station = builder.AddNamedSystem("station", MakeStation(scenario))
        localizer = AddLocalizer(builder, scenario, station)
        error = builder.AddNamedSystem("sighting_error", SightingError(offset))
        planner = builder.AddNamedSystem("planner", MakePlanner(scenario))
        builder.Connect(localizer.get_output_port(), error.get_input_port())
        ConnectPlanner(builder, station, error, planner)
        export_outputs(builder, station)
        builder.ExportOutput(localizer.get_output_port(), "localizer.blobs")
        for name in ("mode", "status"):
            builder.ExportOutput(planner.GetOutputPort(name), f"planner.{name}")
        return builder.Build()

    return make_cell
