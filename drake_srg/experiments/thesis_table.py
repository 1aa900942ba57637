"""The five-axis arm's cell compared with the results of its thesis.

Table 1 of the thesis reports ten grasps of a cylinder at one place. Here that place is
one of the variants, by the thesis's own rules (localizer, taught waypoints, motions and
waits); in the others, the cylinder stands anywhere in the pick region, and the rules
are the thesis's or ours. The experiment also checks the arm's forward kinematics.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.experiments.arm_kinematics import kinematics_rows
from drake_srg.experiments.cycles import Cycle, run_cycle
from drake_srg.experiments.localization import ACTUAL
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.recording.timeline import COLORS, make_figure, style_axes

_AT_ITS_PLACE = f"object.position={ACTUAL[:2].tolist()}"


@dc.dataclass(frozen=True)
class Variant:
    """A way to do the task.

    Attributes:
        scenario: Name of the scenario.
        overrides: `KEY=VALUE` each.
        most: Most runs, with a seed each; None: as many as asked for.
    """

    scenario: str
    overrides: tuple[str, ...] = ()
    most: int | None = None


OURS, RULES = "ours", "thesis's rules"
AT_PLACE = f"{RULES}, at its place"
VARIANTS: Mapping[str, Variant] = {
    OURS: Variant("assistive_arm"),
    "ours, flat fingertips": Variant("assistive_arm_flat"),
    # As many as in the thesis; only the friction differs from run to run.
    AT_PLACE: Variant("assistive_arm_thesis", (_AT_ITS_PLACE,), 10),
    RULES: Variant("assistive_arm_thesis"),
}

_SEATED, _LIFTED = "seated in the recess", "grasped and lifted"
_CYCLE, _LONGEST = "mean cycle [s]", "longest cycle [s]"
_PLACED_IN = "mean time to placement [s]"
_SMOOTHNESS = "mean smoothness []"
_PLACED = tuple(f"largest placement error, {axis} [mm]" for axis in "xy")
_SEEN = tuple(f"largest localisation error, {axis} [mm]" for axis in "xyz")
# Table 1 of the thesis.
THESIS = {
    _CYCLE: 23.69,
    _PLACED[0]: 4.0,
    _PLACED[1]: 2.0,
    _SEEN[0]: 0.07,
    _SEEN[1]: 0.07,
    _SEEN[2]: 15.0,
}
# Our own bounds where they are tighter: half of the recess's clearance. In the plane,
# the thesis bounds the localisation.
BOUNDS = {_LONGEST: 8.0, _PLACED[0]: 0.5, _PLACED[1]: 0.5, _SEEN[2]: 0.3}
# How well P0, P3 and P4 of `assistive_arm_thesis`, which the thesis does not publish,
# must reproduce its cycle time [s].
_FIT_WITHIN = 0.25


def run(track: Track, *, seeds: int = 50, quick: bool = False) -> ExperimentResult:
    """Run every variant from every position.

    Args:
        track: Shows progress.
        seeds: Number of positions.
        quick: Whether to run 5 positions only.
    """
    count = 5 if quick else seeds
    cases = [
        (name, seed)
        for name, variant in VARIANTS.items()
        for seed in range(min(count, variant.most or count))
    ]
    cycles: dict[str, list[Cycle]] = {name: [] for name in VARIANTS}
    for name, seed in track(cases, lambda case: f"{case[0]}, seed {case[1]}"):
        variant = VARIANTS[name]
        cycles[name].append(run_cycle(variant.scenario, seed, variant.overrides))
    rows = [row for name in cycles for row in judge(name, cycles)]
    lines = [line(name, c) for name, runs in cycles.items() for c in runs]
    table = {column: [line[column] for line in lines] for column in lines[0]}
    return ExperimentResult(rows + kinematics_rows(), {"cycles": table}, draw(cycles))


def judge(name: str, cycles: Mapping[str, Sequence[Cycle]]) -> list[Row]:
    """Judge a variant by the thesis's table and, if it is ours, by the thesis's rules.

    Ours must seat every cylinder and be no worse than what the thesis's rules give in
    the same run. What those give is compared with the thesis's table.

    Args:
        name: Of the variant.
        cycles: Of all variants.
    """
    values, count = figures(cycles[name]), len(cycles[name])
    if name in (AT_PLACE, RULES):
        # Cycle time and sightings are reproduced at its place, not beaten. Elsewhere,
        # the tip goes other ways, so the cycle takes another time.
        rows = _limits(name, values, count, {key: THESIS[key] for key in _PLACED})
        return rows if name == RULES else [*rows, *_fit(name, values)]
    limits = {**THESIS, **BOUNDS} if name == OURS else dict(THESIS)
    rules = figures(cycles[RULES])
    return [
        *_limits(name, values, count, limits),
        _compared(name, _PLACED_IN, values, rules, Row.at_most),
        _compared(name, _SMOOTHNESS, values, rules, Row.at_least),
    ]


def _limits(
    name: str, values: Mapping[str, float], count: int, limits: Mapping[str, float]
) -> list[Row]:
    """Expect every cylinder lifted and seated, and figures within limits."""
    rows = [
        Row.at_least(name, what, count, values[what], "") for what in (_LIFTED, _SEATED)
    ]
    for what, limit in limits.items():
        rows.append(Row.at_most(name, *_named(what, values, limit)))
    return rows


def _fit(name: str, values: Mapping[str, float]) -> list[Row]:
    """Expect the thesis's cycle time, to which P0, P3 and P4 are chosen, and height.

    The errors in x and y depend on a camera that the thesis does not publish; see
    `thesis_localizer`.
    """
    return [
        Row.within(name, *_named(_CYCLE, values, THESIS[_CYCLE]), absolute=_FIT_WITHIN),
        Row.within(name, *_named(_SEEN[2], values, THESIS[_SEEN[2]]), absolute=0.1),
    ]


def _compared(
    name: str,
    what: str,
    values: Mapping[str, float],
    rules: Mapping[str, float],
    make_row: Any,
) -> Row:
    """Expect a figure no worse than by the thesis's rules in the same run."""
    quantity, limit, value, unit = _named(what, values, rules[what])
    row: Row = make_row(
        name, f"{quantity}; expected: by the thesis's rules", limit, value, unit
    )
    return row


def _named(
    what: str, values: Mapping[str, float], limit: float
) -> tuple[str, float, float, str]:
    """Return quantity, limit, value and unit of a figure."""
    quantity, unit = what.removesuffix("]").split(" [")
    return quantity, limit, values[what], unit


def figures(cycles: Sequence[Cycle]) -> dict[str, float]:
    """Return the figures of a variant by name; errors are the largest of all cycles."""
    metrics = [c.metrics for c in cycles]

    def known(values: Sequence[float | None]) -> Any:
        return np.array([value for value in values if value is not None])

    times = known([m.cycle_time_s for m in metrics])
    placing = known([m.time_to_placement_s for m in metrics])
    smoothness = known([m.smoothness for m in metrics])
    seen = _largest([m.localization_error_m for m in metrics])
    # Of every cylinder that was released, seated or not.
    placed = _largest(
        [c.metrics.placement_error_m for c in cycles if c.error_G is not None]
    )
    return {
        _LIFTED: float(sum(bool(m.grasp_lifted) for m in metrics)),
        _SEATED: float(sum(m.success for m in metrics)),
        _CYCLE: float(np.mean(times)) if len(times) else np.nan,
        _PLACED_IN: float(np.mean(placing)) if len(placing) else np.nan,
        _LONGEST: float(np.max(times, initial=-np.inf)),
        **dict(zip(_PLACED, placed[:2], strict=True)),
        **dict(zip(_SEEN, seen, strict=True)),
        _SMOOTHNESS: float(np.mean(smoothness)) if len(smoothness) else np.nan,
    }


def _largest(errors: Sequence[Sequence[float] | None]) -> list[float]:
    """Return the largest absolute error on each axis [mm]; NaN without errors."""
    known = [1e3 * np.abs(error) for error in errors if error is not None]
    return list(map(float, np.max(known, axis=0))) if known else [np.nan] * 3


def line(variant: str, cycle: Cycle) -> dict[str, Any]:
    """Return a row of the table."""
    m = cycle.metrics

    def vector(name: str, value: Sequence[float] | None) -> dict[str, float]:
        numbers = [np.nan] * 3 if value is None else value
        return {f"{name} {axis} [m]": x for axis, x in zip("xyz", numbers, strict=True)}

    def number(value: float | None) -> float:
        return np.nan if value is None else value

    return {
        "variant": variant,
        "seed": cycle.seed,
        "seated": int(m.success),
        "failure": m.failure or "",
        "attempts": m.attempts,
        "lifted": "" if m.grasp_lifted is None else int(m.grasp_lifted),
        "cycle [s]": number(m.cycle_time_s),
        "time to placement [s]": number(m.time_to_placement_s),
        **vector("localisation error", m.localization_error_m),
        **vector("placement error", m.placement_error_m),
        "tilt [rad]": number(m.placement_tilt_rad),
        "shift while closing [m]": number(m.grasp_shift_m),
        "smoothness": number(m.smoothness),
    }


def draw(cycles: Mapping[str, Sequence[Cycle]]) -> Any:
    """Draw final positions in the recess and cycle times."""
    count = max(len(runs) for runs in cycles.values())
    figure = make_figure(9.0, 4.6, f"Up to {count} cycles per variant")
    left, right = figure.subplots(1, 2)
    style_axes(left, xlabel="x from the middle of the recess [mm]", ylabel="y [mm]")
    style_axes(right, xlabel="cycle time [s]", ylabel="cycles")
    times = []
    for color, runs in zip(COLORS, cycles.values(), strict=False):
        good = [c.metrics for c in runs if c.metrics.success]
        if good:
            errors = np.array([m.placement_error_m for m in good], dtype=float)
            left.plot(*1e3 * errors[:, :2].T, "o", ms=3, color=color)
        times.append([m.cycle_time_s for m in good])
    circle = np.linspace(0.0, 2.0 * np.pi, 100)
    left.plot(np.cos(circle), np.sin(circle), color=COLORS[-1], lw=0.8)
    for y, text in ((-0.9, "clearance"), (0.8, "thesis: 4 and 2 mm")):
        left.text(0.0, y, text, fontsize=8, ha="center", color=COLORS[-1])
    left.set_aspect("equal", adjustable="datalim")
    right.hist(
        times, np.arange(0.0, 33.0), color=COLORS[: len(times)], label=list(cycles)
    )
    right.axvline(THESIS[_CYCLE], color=COLORS[-1], lw=0.8)
    right.text(
        *(THESIS[_CYCLE], 0.95, "thesis "),
        ha="right",
        fontsize=8,
        transform=right.get_xaxis_transform(),
    )
    figure.legend(loc="outside lower center", ncols=2, fontsize=8, frameon=False)
    return figure
