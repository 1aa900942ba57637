"""Flat and curved fingertips that grasp a cylinder off its middle and carry it fast.

The thesis of the five-axis arm reports that flat fingertips let the object slip, and
cuts them to the object's shape. Here, errors added to the sightings make the hand stop
up to 8 mm short of the cylinder, along the palm's x, or beside it, along the palm's y.
The planner does not look a second time. The cylinder's friction is as in the scenario's
smoothest case ("dry") or lower ("greasy"). The arm carries it as fast as the servos
allow and sets it down on the flat part of the table.

A time step moves a held object along the tangent of its path, but the hand along the
arc. That separates them by a distance proportional to the step, however firm the grip.
What remains at step 0, extrapolated from two steps, is slip.

Take an arc of radius r that spans +-a, and a cylinder of the same radius at an offset
d. The cylinder touches the arc's end, where the surface normal is at asin(sin(a) - d /
r) to the closing direction. Closing pushes the cylinder to the middle if that angle
exceeds the angle of friction, that is up to d = r (sin(a) - sin(atan(mu))). The arcs of
the models have three faces, the outer ones at 27 degrees: with dry friction, atan(0.5),
they hardly push at all.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.experiments.cycles import Cycle, run_cycle
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.sighting_error import cell_maker
from drake_srg.recording.timeline import COLORS, make_figure, style_axes

SCENARIOS = {"curved": "assistive_arm", "flat": "assistive_arm_flat"}
FRICTION = {"dry": 0.5, "greasy": 0.15}
OFFSETS = tuple(map(float, range(9)))  # mm
# Surface, direction and offsets [mm]; beyond 8 mm the cylinder may be lost.
SERIES = (
    ("dry", "x", (*OFFSETS, 10.0, 12.0, 14.0)),
    ("dry", "y", OFFSETS),
    ("greasy", "x", OFFSETS),
)
# The cylinder stands straight in front of the arm, where the palm's x and y are
# opposite to the world's: errors of sightings by offset and direction.
_POSITION = [-0.325, -0.17282]
_OFF = {"x": np.array([1.0, 0.0, 0.0]), "y": np.array([0.0, 1.0, 0.0])}
_STEP = 0.001  # s
_RADIUS, _ARC = 0.0125, np.deg2rad(40.0)  # of the pads, tools/models/linkage_gripper.py
# Largest error with which a cylinder still fits a recess of 1 mm clearance [mm].
_CLEARANCE = 1.0
_SLIP = 0.1 * _CLEARANCE  # largest slip of a firm grip [mm]
_OVERRIDES = (
    f"object.position={_POSITION}",
    # Beside the recess, so that the final position shows how the cylinder was held.
    "task.place={position: [0.05, 0.145], height: 0.1, tolerance: 0.02}",
    "planner.look_before_grasp=false",
    "planner.look_before_place=false",
    "planner.max_attempts=1",
    "planner.holding_speed=1.0",
    "planner.holding_acceleration=1.0",
)


@dc.dataclass(frozen=True)
class Case:
    """Fingertips, cylinder and the offset at which the hand grasps it."""

    pads: str  # curved, flat
    surface: str  # dry, greasy
    direction: str  # x, y
    offset: float  # mm
    step: float = _STEP  # s

    @property
    def group(self) -> str:
        """Everything but offset and step."""
        return f"{self.pads}, {self.surface}, along {self.direction}"

    def __str__(self) -> str:
        return f"{self.group}, {self.offset:g} mm"


def fingertip_cases() -> list[Case]:
    """Return all cases: `SERIES` with both pads, and coarse steps that show slip."""
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
    """Run the cycle of a case."""
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
    """Grasp and carry the cylinder in every case."""
    cycles = {case: take(case) for case in track(fingertip_cases())}
    columns = [line(case, cycle) for case, cycle in cycles.items()]
    table = {name: [column[name] for column in columns] for name in columns[0]}
    return ExperimentResult(judge(cycles), {"grasps": table}, draw(cycles))


def left(case: Case, cycle: Cycle) -> float:
    """Return the offset that remains after closing [mm]; NaN if not held."""
    if cycle.p_GO_open is None or cycle.p_GO_held is None:
        return np.nan
    i = "xyz".index(case.direction)
    return float(1e3 * (cycle.p_GO_held - cycle.p_GO_open)[i] + case.offset)


def slip(cycle: Cycle) -> float:
    """Return the motion in the hand while carried [mm]; NaN if not held."""
    return np.nan if cycle.slip is None else 1e3 * cycle.slip


def turn(cycle: Cycle) -> float:
    """Return the rotation in the hand while carried [degrees]; NaN if not held."""
    return np.nan if cycle.turn is None else float(np.rad2deg(cycle.turn))


def line(case: Case, cycle: Cycle) -> dict[str, Any]:
    """Return a row of the table."""
    return {
        **dc.asdict(case),
        "success": int(cycle.metrics.success),
        "failure": cycle.metrics.failure or "",
        "remaining offset [mm]": left(case, cycle),
        "slip [mm]": slip(cycle),
        "turn [degrees]": turn(cycle),
    }


def up_to(cases: Sequence[Case], good: Callable[[Case], bool]) -> float:
    """Return the offset up to which all cases are good [mm]; NaN if none is.

    Args:
        cases: In the order of their offsets.
        good: Whether a case is good.
    """
    farthest = np.nan
    for case in cases:
        if not good(case):
            break
        farthest = case.offset
    return farthest


def centered_up_to(friction: float) -> float:
    """Return the largest offset that rigid curved pads centre [mm]."""
    return float(1e3 * _RADIUS * (np.sin(_ARC) - np.sin(np.arctan(friction))))


def _groups(cases: Iterable[Case]) -> dict[str, list[Case]]:
    """Return the cases with the fine step, by group."""
    groups: dict[str, list[Case]] = {}
    for case in cases:
        if case.step == _STEP:
            groups.setdefault(case.group, []).append(case)
    return groups


def judge(cycles: Mapping[Case, Cycle]) -> list[Row]:
    """Expect a firm hold up to 8 mm, and curved pads to centre a greasy cylinder.

    Arcs reach 8 mm on both sides of their middle, flat pads 9 mm; the open hand leaves
    12 mm on both sides. Pads that yield centre less far than rigid arcs.
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
        rows.append(
            Row.at_least(group, "grasped, up to an offset of", OFFSETS[-1], held, "mm")
        )
        near = [case for case in cases if case.offset in OFFSETS]
        name = f"centred within {_CLEARANCE:g} mm, up to an offset of"
        if first.direction == "y":
            spread = float(np.ptp([left(case, cycles[case]) for case in near]))
            rows.append(
                Row.at_most(group, "spread of final offsets", _CLEARANCE, spread, "mm")
            )
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
            Row.info(group, "motion while carried, step 1 ms", moved, "mm"),
            Row.info(group, "rotation while carried", turned, "degrees"),
        ]
    for case, cycle in cycles.items():
        if case.step != _STEP:
            fine = dc.replace(case, step=_STEP)
            none = abs(2.0 * slip(cycles[fine]) - slip(cycle))
            name = "slip, extrapolated to step 0"
            rows.append(Row.at_most(str(fine), name, _SLIP, none, "mm"))
    return rows


def draw(cycles: Mapping[Case, Cycle]) -> Any:
    """Draw the offset that remains after closing, and the motion while carried."""
    figure = make_figure(9.5, 4.0, "A cylinder grasped off its middle")
    panels = figure.subplots(1, 3)
    panels[1].sharey(panels[0])
    style_axes(panels[0], xlabel="offset along x [mm]", ylabel="remaining offset [mm]")
    style_axes(panels[1], xlabel="offset along y [mm]", ylabel="remaining offset [mm]")
    style_axes(
        panels[2], xlabel="offset [mm]", ylabel="motion while carried, step 1 ms [mm]"
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
        # Lost cylinders are not shown.
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
