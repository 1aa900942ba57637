"""The figure of `servo_laws`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drake_srg.experiments.servo_bench import Response
from drake_srg.recording.timeline import COLORS, make_figure, style_axes

# Style of each law's line. Both laws of the thesis are dashed with K_I = 0.
_LINES: dict[str, dict[str, Any]] = {
    "pid": {"color": COLORS[0], "lw": 1.6},
    "pid, 1023 steps": {"color": "0.5", "lw": 1.0},
    "pid, 100 steps": {"color": COLORS[6], "lw": 1.0},
    "pid, K_I": {"color": COLORS[1], "lw": 1.0},
    "pid, K_I, no anti-windup": {"color": COLORS[1], "lw": 1.0, "ls": ":"},
    "printed": {"color": COLORS[3], "lw": 1.0},
    "printed, K_I = 0": {"color": COLORS[3], "lw": 1.0, "ls": (0, (3, 3))},
    "literal": {"color": COLORS[2], "lw": 1.0},
    "literal, K_I = 0": {"color": COLORS[2], "lw": 1.0, "ls": (0, (3, 3))},
}
_WITH_KI = ("pid", "pid, K_I", "printed", "literal")
# Title, motion, laws drawn, limits of time, angle and PWM (None: all).
_PANELS: list[tuple[str, str, tuple[str, ...], tuple[Any, Any, Any]]] = [
    ("Step, PWM limit 0.3", "step", _WITH_KI, (None, None, None)),
    ("Load of 0.2 N m, servo at 1 kHz", "load", _WITH_KI, (None, None, None)),
    (
        "Blocked from 0.1 to 0.6 s",
        "blocked",
        ("pid", "pid, K_I", "pid, K_I, no anti-windup", "printed", "literal"),
        (None, None, None),
    ),
    ("Closing until the fingers meet", "grip", _WITH_KI, (None, None, None)),
    (
        "Closing and opening",
        "minimum_jerk",
        ("pid", "printed", "printed, K_I = 0", "literal", "literal, K_I = 0"),
        (None, None, None),
    ),
    (
        "The same, 0.7 of required PWM",
        "minimum_jerk_limited",
        ("pid", "pid, K_I", "printed", "printed, K_I = 0", "literal"),
        (None, None, None),
    ),
    (
        "Sine, 0.7 of required PWM",
        "sine_limited",
        ("pid", "pid, K_I", "printed", "printed, K_I = 0", "literal"),
        (None, None, None),
    ),
    (
        "PWM steps: end of the step",
        "step",
        ("pid", "pid, 1023 steps", "pid, 100 steps"),
        ((0.25, 1.5), (0.99, 1.002), (-0.04, 0.02)),
    ),
]


def draw(responses: Mapping[str, Mapping[str, Response]]) -> Any:
    """Draw angle above PWM.

    Args:
        responses: By motion and law; laws of a panel may be missing.
    """
    figure = make_figure(14.0, 8.5, "Left base joint under the servo laws")
    all_axes = figure.subplots(4, 4, height_ratios=[2, 1, 2, 1])
    lines: dict[str, Any] = {}
    for k, (title, motion, laws, limits) in enumerate(_PANELS):
        row, column = 2 * (k // 4), k % 4
        angle, pwm = all_axes[row, column], all_axes[row + 1, column]
        style_axes(angle, ylabel="angle [rad]" if column == 0 else "")
        style_axes(pwm, xlabel="time [s]", ylabel="PWM" if column == 0 else "")
        angle.sharex(pwm)
        angle.tick_params(labelbottom=False)
        angle.set_title(title, fontsize=9, loc="left")
        for law in laws:
            if response := responses[motion].get(law):
                (lines[law],) = angle.plot(response.time, response.q, **_LINES[law])
                pwm.plot(response.time, response.pwm, **_LINES[law])
        any_response = next(iter(responses[motion].values()))
        reference = (any_response.time, any_response.reference)
        (lines["reference"],) = angle.plot(*reference, "k--", lw=0.8)
        pwm.set(xlim=limits[0], ylim=limits[2])
        angle.set_ylim(limits[1])
    figure.align_ylabels(all_axes[:, 0])
    figure.legend(
        lines.values(),
        lines.keys(),
        loc="outside lower center",
        ncols=5,
        fontsize=8,
        frameon=False,
    )
    return figure
