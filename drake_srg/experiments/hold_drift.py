"""Creep of a held can and box, by step, contact approximation and stiction tolerance.

With regularised contact, anything held by friction slides slowly, at a rate that the
solver's settings determine. Users of MuJoCo report 50 to 2,300 um/s.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments.data import household_objects
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import object_facts
from drake_srg.objects.models import simple_shape
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Box, Vector

LIMIT = 3.0  # in the accurate scenario [um/s]
BENCH = "gripper_bench"
ACCURATE, FAST = f"{BENCH}_accurate", f"{BENCH}_fast"
_APPROXIMATION = "plant_config.discrete_contact_approximation"
_STICTION = "plant_config.stiction_tolerance"
# Scenario and changes.
SETTINGS: dict[str, tuple[str, dict[str, object]]] = {
    ACCURATE: (ACCURATE, {}),
    FAST: (FAST, {}),
    f"{BENCH}: sap, 2 ms": (BENCH, {}),
    "sap, 1 ms": (BENCH, {"plant_config.time_step": 0.001, "arm.period": 0.001}),
    "sap, 5 ms": (BENCH, {"plant_config.time_step": 0.005, "arm.period": 0.005}),
    **{
        f"{approximation}, 2 ms, {stiction:g} m/s": (
            BENCH,
            {_APPROXIMATION: approximation, _STICTION: stiction},
        )
        for approximation, stiction in (
            *(("sap", 1e-3), ("lagged", 1e-3), ("lagged", 1e-4), ("lagged", 1e-5)),
            ("similar", 1e-4),
        )
    },
}


def things() -> dict[str, tuple[ObjectConfig, float]]:
    """Return the standing can and sugar box, and the palm's height above the table [m].

    Both are grasped from above with their tops at the roots of the pads.
    """
    objects = household_objects()
    can, sugar = objects["005_tomato_soup_can"], objects["004_sugar_box"]
    shape = simple_shape("sugar_box", sugar)
    assert isinstance(shape, Box)
    x, height, y = shape.size  # on its end, the thin side between the fingers
    mass = object_facts("sugar_box", sugar).mass
    box = ObjectConfig(shape=Box([x, y, height]), mass=mass, friction=0.6)
    return {"can": (can, 0.1018 + 0.118), "box": (box, height + 0.118)}


def creep(
    thing: ObjectConfig,
    height: float,
    scenario: str,
    changes: Mapping[str, object],
    duration: float = 10.0,
    force_limit: float = 0.5,
) -> tuple[Vector, Vector]:
    """Grasp an object, lift it, and measure its motion in the hand.

    Args:
        thing: The object.
        height: Of the palm above the table at the grasp [m].
        scenario: The bench.
        changes: Overrides of the bench.
        duration: Of the hold [s].
        force_limit: Of the servo.

    Returns:
        Time, shape (K,) [s], and distance in the palm frame from the position at the
        start of the hold, shape (K,) [m].

    Raises:
        ScenarioError: If the hand does not hold the object after the lift.
    """
    bench = bench_scenario(
        thing,
        home=[0.0, 0.0, height],
        scenario=scenario,
        overrides=[f"{key}={value}" for key, value in changes.items()],
    )
    with Rig(bench, name="hold_drift") as rig:
        rig.advance(3.5, closure=1.0, force_limit=force_limit)
        rig.move([0.0, 0.0, height + 0.06], 1.0)
        rig.advance(1.0)  # until motion from the lift has settled
        start = rig.time
        touching = set(rig.contact_forces())
        if touching != {"gripper"}:
            raise ScenarioError(
                f"hold_drift: {scenario}: the hand holds nothing; the object touches "
                f"{', '.join(sorted(touching)) or 'nothing'}"
            )
        rig.advance(duration)
        log = rig.log()
    held = log["time"] >= start - 1e-6
    # The gantry only translates: object minus hand is the motion in the hand.
    p_GO = log["object_pose.thing"][held, :3] - log["arm.state_measured"][held, :3]
    return log["time"][held] - start, np.linalg.norm(p_GO - p_GO[0], axis=1)


def run(
    track: Track, *, duration: float = 10.0, force_limit: float = 0.5
) -> ExperimentResult:
    """Hold both objects with every setting.

    Args:
        track: Shows progress.
        duration: Of the hold [s].
        force_limit: Of the servo; 0.5 gives 154 N per wire, a firm grip of the box,
            whose weight is 5 N.
    """
    curves = {
        (setting, thing): creep(*config, *SETTINGS[setting], duration, force_limit)
        for setting, (thing, config) in track(
            [(s, thing) for s in SETTINGS for thing in things().items()],
            label=lambda case: f"{case[0]}, {case[1][0]}",
        )
    }
    rates = {key: moved[-1] / duration * 1e6 for key, (_, moved) in curves.items()}
    rows = []
    for (setting, thing), rate in rates.items():
        case, what = f"{thing}, {setting}", f"creep over {duration:g} s"
        if setting == ACCURATE:
            rows.append(Row.at_most(case, what, LIMIT, rate, "um/s"))
        else:
            rows.append(Row.info(case, what, rate, "um/s"))
    table: dict[str, Any] = {
        "setting": [setting for setting, _ in rates],
        "object": [thing for _, thing in rates],
        "creep_um_per_s": list(rates.values()),
    }
    return ExperimentResult(rows, {"creep": table}, _draw(list(SETTINGS), rates))


def _draw(settings: list[str], rates: Mapping[tuple[str, str], float]) -> Any:
    figure = make_figure(8.0, 3.8, "Creep of a held object")
    axes = figure.subplots()
    style_axes(axes, xlabel="creep [um/s]")
    places = np.arange(len(settings))[::-1]
    for i, thing in enumerate(things()):
        widths = [rates[setting, thing] for setting in settings]
        axes.barh(places + 0.2 - 0.4 * i, widths, 0.38, color=COLORS[i], label=thing)
    axes.axvline(LIMIT, color=COLORS[-1], lw=0.8, ls="--")
    axes.set_xscale("log")
    axes.set_yticks(places, settings)
    axes.legend(fontsize=8, frameon=False)
    return figure
