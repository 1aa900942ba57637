"""Flat and curved fingertips that grasp a cylinder off its middle and carry it fast.

The thesis of the five-axis arm reports that flat fingertips let the object slip. Here,
an error of the camera's pose makes the hand miss the cylinder's middle by up to 8 mm:
it stops short, along the palm's x, or beside it, along y. The cylinder is as smooth as
the scenario allows ("dry") or smoother ("greasy"). A time step moves a held object
along the tangent of its path. The motion that remains when extrapolated to a step of 0
is slip.

Suppose the fingertip is an arc of radius r that spans +-a. It pushes a cylinder of the
same radius to the middle up to an offset d = r (sin(a) - sin(atan(mu))). At this
offset, the surface normal at the arc's end is at the angle of friction to the closing
direction.
"""

import itertools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import experiments.runner as ex
from experiments.stands.cycles import run_cycle

SCENARIOS = {"curved": "assistive_arm", "flat": "assistive_arm_flat"}
FRICTION = {"dry": 0.5, "greasy": 0.15}
OFFSETS = tuple(map(float, range(9)))  # mm
# Surface, direction and offsets [mm]; beyond 8 mm the cylinder may be lost.
SERIES = (
    ("dry", "x", (*OFFSETS, 10.0, 12.0, 14.0)),
    ("dry", "y", OFFSETS),
    ("greasy", "x", OFFSETS),
)
_STEP = 0.001  # s
_RADIUS, _ARC = 0.0125, np.deg2rad(40.0)  # of the pads, tools/models/linkage_gripper.py
# Largest error with which a cylinder still fits a recess of 1 mm clearance [mm].
_CLEARANCE = 1.0
_OVERRIDES = (
    # In front of the arm, where the palm's x and y are opposite to the world's.
    "object.position=[-0.325, -0.17282]",
    # Beside the recess, so that the final position shows how the cylinder was held.
    "task.place={position: [0.05, 0.145], height: 0.1, tolerance: 0.02}",
    "planner.look_before_grasp=false",
    "planner.look_before_place=false",
    "planner.max_attempts=1",
    "planner.holding_speed=1.0",
    "planner.holding_acceleration=1.0",
)


def cases() -> list[ex.Case]:
    """Return `SERIES` with both pads, and coarse steps that show slip."""
    ends = (OFFSETS[0], OFFSETS[-1])
    return [
        {"group": f"{pads}, {surface}, along {direction}", "pads": pads}
        | {"surface": surface, "direction": direction, "offset": offset, "step": step}
        for series, step in ((SERIES, _STEP), ((("dry", "x", ends),), 2.0 * _STEP))
        for pads in SCENARIOS
        for surface, direction, offsets in series
        for offset in offsets
    ]


def trial(
    group: str, pads: str, surface: str, direction: str, offset: float, step: float
) -> ex.Measures:
    # The camera's x and y are the world's -y and -x.
    off = {"x": [0.0, -1e-3 * offset, 0.0], "y": [-1e-3 * offset, 0.0, 0.0]}[direction]
    overrides = (
        *_OVERRIDES,
        f"camera_errors.ceiling.translation={off}",
        f"object.friction={FRICTION[surface]}",
        f"plant_config.time_step={step}",
    )
    cycle = run_cycle(SCENARIOS[pads], 0, overrides)
    shift, slip, turn = cycle["shift"], cycle["slip"], cycle["turn"]
    return {
        "held": cycle["placed"],
        "failure": cycle["failure"],
        "left": None if shift is None else 1e3 * shift["xyz".index(direction)] + offset,
        "slip": None if slip is None else 1e3 * slip,
        "turn": None if turn is None else np.rad2deg(turn),
        "fine": step == _STEP,
    }


def up_to(own: ex.Trials, good: Callable[[Mapping[str, Any]], bool]) -> float:
    """Return the offset up to which all cases are good [mm]; NaN without any."""
    found = [t["offset"] for t in itertools.takewhile(good, own.where(fine=True))]
    return found[-1] if found else np.nan


def centered_up_to(own: ex.Trials) -> float:
    return up_to(own, lambda t: t["left"] is not None and abs(t["left"]) <= _CLEARANCE)


def summary(own: ex.Trials) -> ex.Values:
    """Expect a firm hold up to 8 mm, and curved pads to centre a greasy cylinder.

    Arcs reach 8 mm on both sides of their middle, flat pads 9 mm; the open hand leaves
    12 mm on both sides. Pads that yield centre less far than rigid arcs.
    """
    pads, surface, direction = (own[0][k] for k in ("pads", "surface", "direction"))
    near = [t for t in own.where(fine=True) if t["offset"] in OFFSETS]
    left, slip, turn = (
        np.array([t[k] for t in near], dtype=float) for k in ("left", "slip", "turn")
    )
    found: ex.Values = {
        "grasped, up to an offset of [mm]": up_to(own, lambda t: t["held"]),
        "motion while carried, step 1 ms [mm]": max(slip),
        "rotation while carried [degrees]": max(turn),
    }
    if direction == "y":
        return found | {"spread of final offsets [mm]": np.ptp(left)}
    centered, bounds = centered_up_to(own), [ex.number()]
    if pads == "curved":
        rigid = np.sin(_ARC) - np.sin(np.arctan(FRICTION[surface]))
        bounds = [ex.at_most(1e3 * _RADIUS * rigid)]
        if surface == "greasy":
            flat = centered_up_to(own.whole.where(pads="flat", surface="greasy"))
            bounds.append(ex.at_least(np.nan_to_num(flat) + 1.0, source="thesis"))
    what = f"centred within {_CLEARANCE:g} mm, up to an offset of [mm]"
    return found | {what: [(centered, bound) for bound in bounds]}


def no_slip(trials: ex.Trials) -> dict[str, ex.Values]:
    """Extrapolate the motion of a carried cylinder to step 0."""
    found = {}
    for coarse in trials.where(fine=False):
        same = {k: coarse[k] for k in ("group", "offset")}
        fine = trials.where(fine=True, **same).one("slip")
        rest = abs(2.0 * (fine or np.nan) - (coarse["slip"] or np.nan))
        name = f"{coarse['group']}, {coarse['offset']:g} mm"
        found[name] = {"slip, extrapolated to step 0 [mm]": rest}
    return found


fingertips = ex.Experiment(
    "Flat and curved fingertips that grasp a cylinder off its middle, carried fast.",
    cases,
    trial,
    {
        "grasped, up to an offset of": ex.at_least(OFFSETS[-1]),
        "spread of final offsets": ex.at_most(_CLEARANCE),
        "slip, extrapolated to step 0": ex.at_most(0.1 * _CLEARANCE),
    },
    summary=summary,
    whole=no_slip,
    picture=[ex.Points("offset", "left"), ex.Points("offset", "slip")],
)
