"""Flat and curved fingertips that take a cylinder beside its middle, and carry it fast.

The thesis of the five-axis arm says that flat fingertips let the object slip, and cuts
them to its shape. Here the hand goes up to 8 mm short of the cylinder, along the palm's
x, and beside it, along its y: the planner is told so by sightings that are off, and
looks no second time. The cylinder is as slippery as in the scenario's smoothest case
("dry"), and as something greasy; it is carried as fast as the servos can, and set down
on the table's even part.

A step moves what is held along the tangent of its way, the hand along the arc. That
takes the one out of the other by a distance in proportion to the step, however firm the
grip: what is left at a step of zero, extrapolated from two, is slip.

An arc of radius r that spans +-a, and a cylinder of the same radius at the offset d: it
touches the arc's end, where the surface normal is at asin(sin(a) - d / r) to the
closing direction. Closing pushes it to the middle where that is more than the angle of
friction, so up to d = r (sin(a) - sin(atan(mu))). The models' arcs are of three faces,
the outer ones at 27 degrees: against dry friction, atan(0.5), they push hardly at all.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from drake_srg.cell import ConnectPlanner, MakePlanner
from drake_srg.cell.perception import AddLocalizer
from drake_srg.common.ports import export_outputs
from drake_srg.experiments.cycles import Cycle, run_cycle
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.lifetime import LeafSystem
from drake_srg.recording.figure import COLORS, make_figure, style_axes
from drake_srg.scenario import Scenario
from drake_srg.station import MakeStation
from drake_srg.types import Blob, Vector

SCENARIOS = {"curved": "assistive_arm", "flat": "assistive_arm_flat"}
FRICTION = {"dry": 0.5, "greasy": 0.15}
OFFSETS = tuple(map(float, range(9)))  # mm
# Surface, direction and offsets [mm]; beyond 8 mm it may be lost.
SERIES = (
    ("dry", "x", (*OFFSETS, 10.0, 12.0, 14.0)),
    ("dry", "y", OFFSETS),
    ("greasy", "x", OFFSETS),
)
# The cylinder stands straight in front of the arm, where the palm's x and y are the
# world's, turned half round: sightings that are off by this let the hand end there.
_POSITION = [-0.325, -0.17282]
_OFF = {"x": np.array([1.0, 0.0, 0.0]), "y": np.array([0.0, 1.0, 0.0])}
_STEP = 0.001  # s
_RADIUS, _ARC = 0.0125, np.deg2rad(40.0)  # of the pads, tools/models/linkage_gripper.py
# A recess with 1 mm of clearance takes what is no further off [mm].
_CLEARANCE = 1.0
_SLIP = 0.1 * _CLEARANCE  # of a firm grip [mm]
_OVERRIDES = (
    f"object.position={_POSITION}",
    # Beside the recess; where it ends tells how it was held, not how it was seen.
    "task.place={position: [0.05, 0.145], height: 0.1, tolerance: 0.02}",
    "planner.look_before_grasp=false",
    "planner.look_before_place=false",
    "planner.max_attempts=1",
    "planner.holding_speed=1.0",
    "planner.holding_acceleration=1.0",
)


@dc.dataclass(frozen=True)
class Case:
    """How the cylinder is taken."""

    pads: str  # curved, flat
    surface: str  # dry, greasy
    direction: str  # x, y
    offset: float  # mm
    step: float = _STEP  # s

    @property
    def group(self) -> str:
        """All but the offset."""
        return f"{self.pads}, {self.surface}, along {self.direction}"

    def __str__(self) -> str:
        return f"{self.group}, {self.offset:g} mm"


class SightingError(LeafSystem):
    """Moves all sightings by the same.

    .. pydrake_system::

        name: SightingError
        input_ports:
        - blobs_seen
        output_ports:
        - blobs

    Args:
        offset: What is added to the positions of the list[Blob], (3,) [m].
    """

    def __init__(self, offset: Vector) -> None:
        super().__init__()
        self._offset = np.array(offset)
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
            [dc.replace(blob, position=blob.position + self._offset) for blob in seen]
        )


def cell_maker(offset: Vector) -> Callable[[Scenario], Diagram]:
    """Return what makes a cell whose sightings are off by `offset` (3,) [m]."""

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


def fingertip_cases() -> list[Case]:
    """Return what is tried with either pads: `SERIES`, and what tells slip."""
    series = [
        Case(pads, surface, direction, offset)
        for pads in SCENARIOS
        for surface, direction, offsets in SERIES
        for offset in offsets
    ]
    coarse = [
        Case(pads, "dry", "x", offset, 2.0 * _STEP)
        for pads in SCENARIOS
        for offset in (OFFSETS[0], OFFSETS[-1])
    ]
    return series + coarse


def take(case: Case) -> Cycle:
    """Run a cycle."""
    return run_cycle(
        SCENARIOS[case.pads],
        seed=0,
        overrides=[
            *_OVERRIDES,
            f"object.friction={FRICTION[case.surface]}",
            f"plant_config.time_step={case.step}",
        ],
        make_cell=cell_maker(1e-3 * case.offset * _OFF[case.direction]),
    )


def run(track: Track) -> ExperimentResult:
    """Take the cylinder beside its middle, in all ways."""
    cycles = {case: take(case) for case in track(fingertip_cases())}
    columns = [line(case, cycle) for case, cycle in cycles.items()]
    table = {name: [column[name] for column in columns] for name in columns[0]}
    return ExperimentResult(judge(cycles), {"grasps": table}, draw(cycles))


def left(case: Case, cycle: Cycle) -> float:
    """What closing leaves of the offset, in its direction [mm]; NaN if not held."""
    if cycle.p_GO_open is None or cycle.p_GO_held is None:
        return np.nan
    i = "xyz".index(case.direction)
    return float(1e3 * (cycle.p_GO_held - cycle.p_GO_open)[i] + case.offset)


def slip(cycle: Cycle) -> float:
    """Motion in the hand while carried [mm]; NaN if not held."""
    return np.nan if cycle.slip is None else 1e3 * cycle.slip


def turn(cycle: Cycle) -> float:
    """Turn in the hand while carried [degrees]; NaN if not held."""
    return np.nan if cycle.turn is None else float(np.rad2deg(cycle.turn))


def line(case: Case, cycle: Cycle) -> dict[str, Any]:
    """Return a line of the table."""
    return {
        **dc.asdict(case),
        "success": int(cycle.metrics.success),
        "failure": cycle.metrics.failure or "",
        "left after closing [mm]": left(case, cycle),
        "slip [mm]": slip(cycle),
        "turn [degrees]": turn(cycle),
    }


def up_to(cases: Sequence[Case], good: Callable[[Case], bool]) -> float:
    """Return the offset up to which all cases are good [mm]; NaN if the first is not.

    Args:
        cases: In the order of their offsets.
        good: Whether one is.
    """
    farthest = np.nan
    for case in cases:
        if not good(case):
            break
        farthest = case.offset
    return farthest


def centered_up_to(friction: float) -> float:
    """Return the largest offset that curved pads push to the middle [mm]."""
    return float(1e3 * _RADIUS * (np.sin(_ARC) - np.sin(np.arctan(friction))))


def _groups(cases: Iterable[Case]) -> dict[str, list[Case]]:
    groups: dict[str, list[Case]] = {}
    for case in cases:
        if case.step == _STEP:
            groups.setdefault(case.group, []).append(case)
    return groups


def judge(cycles: Mapping[Case, Cycle]) -> list[Row]:
    """Expect a firm hold up to 8 mm, and that curved pads center what is greasy.

    Arcs reach 8 mm before and behind their middle, flat pads 9 mm; the open hand leaves
    12 mm on both sides. Pads that give way center less far than rigid arcs would.
    """
    groups = _groups(cycles)
    centered = {
        group: up_to(cases, lambda case: abs(left(case, cycles[case])) <= _CLEARANCE)
        for group, cases in groups.items()
    }
    rows = []
    for group, cases in groups.items():
        first = cases[0]
        held = up_to(cases, lambda case: cycles[case].metrics.success)
        rows.append(Row.at_least(group, "taken, offset up to", OFFSETS[-1], held, "mm"))
        near = [case for case in cases if case.offset in OFFSETS]
        name = f"centered within {_CLEARANCE:g} mm, offset up to"
        if first.direction == "y":
            spread = float(np.ptp([left(case, cycles[case]) for case in near]))
            rows.append(Row.at_most(group, "ends differ by", _CLEARANCE, spread, "mm"))
        elif first.pads == "flat":
            rows.append(Row.info(group, name, centered[group], "mm"))
        else:
            rigid = centered_up_to(FRICTION[first.surface])
            rows.append(Row.at_most(group, name, rigid, centered[group], "mm"))
        if (first.pads, first.surface) == ("curved", "greasy"):
            flat = centered[dc.replace(first, pads="flat").group]
            more = np.nan_to_num(flat) + 1.0
            rows.append(Row.at_least(group, name, more, centered[group], "mm"))
        moved, turned = (
            float(np.max([f(cycles[case]) for case in near])) for f in (slip, turn)
        )
        rows += [
            Row.info(group, "moved while carried, at a step of 1 ms", moved, "mm"),
            Row.info(group, "turned while carried", turned, "degrees"),
        ]
    for case, cycle in cycles.items():
        if case.step != _STEP:
            fine = dc.replace(case, step=_STEP)
            none = abs(2.0 * slip(cycles[fine]) - slip(cycle))
            name = "slip, at a step of zero"
            rows.append(Row.at_most(str(fine), name, _SLIP, none, "mm"))
    return rows


def draw(cycles: Mapping[Case, Cycle]) -> Any:
    """Draw what closing leaves of an offset, and the motion while carried."""
    figure = make_figure(9.5, 4.0, "A cylinder taken beside its middle")
    panels = figure.subplots(1, 3)
    panels[1].sharey(panels[0])
    style_axes(panels[0], xlabel="offset along x [mm]", ylabel="left of it [mm]")
    style_axes(panels[1], xlabel="offset along y [mm]", ylabel="left of it [mm]")
    style_axes(
        panels[2], xlabel="offset [mm]", ylabel="moved while carried, step 1 ms [mm]"
    )
    for group, cases in _groups(cycles).items():
        first = cases[0]
        style = {
            "color": COLORS[list(SCENARIOS).index(first.pads)],
            "ls": "-" if first.surface == "dry" else ":",
            "marker": "o" if first.direction == "x" else "s",
            "ms": 3.5,
            "lw": 1.2,
        }
        # What was lost is not shown.
        kept = [case for case in cases if cycles[case].metrics.success]
        offsets = [case.offset for case in kept]
        ends = [left(case, cycles[case]) for case in kept]
        panels["xy".index(first.direction)].plot(offsets, ends, **style)
        moved = [slip(cycles[case]) for case in kept]
        panels[2].plot(offsets, moved, **style, label=group)
    panels[0].plot((0.0, 12.0), (0.0, 12.0), color=COLORS[-1], lw=0.5)
    panels[2].set_ylim(0.0)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure
