"""Creep of a held can and box, by step, contact approximation and stiction tolerance.

Regularised contact lets whatever friction holds slide slowly; how fast is up to the
solver's settings. Users of MuJoCo report 50 to 2,300 um/s.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from drake_srg.common.errors import ScenarioError
from drake_srg.experiments.objects import household_objects
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.objects.config import ObjectConfig
from drake_srg.recording.figure import COLORS, make_figure, style_axes
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Box, Vector

HOLD = 10.0  # s
FORCE_LIMIT = 0.5  # 154 N at each wire: a firm grip of the box, which weighs 5 N
LIMIT = 3.0  # in the accurate scenario [um/s]
BENCH = "gripper_bench"
ACCURATE, FAST = f"{BENCH}_accurate", f"{BENCH}_fast"
_APPROXIMATION = "plant_config.discrete_contact_approximation"
_STICTION = "plant_config.stiction_tolerance"
# Scenario and what is changed in it.
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
    """The can and the sugar box, standing, and the palm's height above the table [m].

    Both are taken from above with their tops at the roots of the pads.
    """
    objects = household_objects()
    can, box = objects["005_tomato_soup_can"], objects["004_sugar_box"]
    assert isinstance(box.shape, Box)
    x, height, y = box.shape.size  # on its end, the thin side between the fingers
    box.shape = Box([x, y, height])
    return {"can": (can, 0.1018 + 0.118), "box": (box, height + 0.118)}


def creep(
    thing: ObjectConfig, height: float, scenario: str, changes: Mapping[str, object]
) -> tuple[Vector, Vector]:
    """Grasp an object, lift it, and watch it in the hand for `HOLD`.

    Returns:
        Time (K) [s] and distance from where it was in the palm frame (K) [m].

    Raises:
        ScenarioError: If it is not in the hand: there is no grip whose creep to tell.
    """
    bench = bench_scenario(
        thing,
        home=[0.0, 0.0, height],
        scenario=scenario,
        overrides=[f"{key}={value}" for key, value in changes.items()],
    )
    with Rig(bench, name="hold_drift") as rig:
        rig.advance(3.5, closure=1.0, force_limit=FORCE_LIMIT)
        rig.move([0.0, 0.0, height + 0.06], 1.0)
        rig.advance(1.0)  # what the lift moved comes to rest
        start = rig.time
        touching = set(rig.contact_forces())
        if touching != {"gripper"}:
            raise ScenarioError(
                f"hold_drift: {scenario}: nothing is held; the object touches "
                f"{', '.join(sorted(touching)) or 'nothing'}"
            )
        rig.advance(HOLD)
        log = rig.log()
    held = log["time"] >= start - 1e-6
    # The gantry does not turn the hand.
    p_GO = log["object_pose.thing"][held, :3] - log["arm.state_measured"][held, :3]
    return log["time"][held] - start, np.linalg.norm(p_GO - p_GO[0], axis=1)


def run(track: Track) -> ExperimentResult:
    """Hold both objects with every setting."""
    curves = {
        (setting, thing): creep(*config, *SETTINGS[setting])
        for setting, (thing, config) in track(
            [(s, thing) for s in SETTINGS for thing in things().items()],
            label=lambda case: f"{case[0]}, {case[1][0]}",
        )
    }
    rates = {key: moved[-1] / HOLD * 1e6 for key, (_, moved) in curves.items()}
    rows = []
    for (setting, thing), rate in rates.items():
        case, what = f"{thing}, {setting}", "creep over 10 s"
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
    figure = make_figure(8.0, 3.8, "Creep of what is held")
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
