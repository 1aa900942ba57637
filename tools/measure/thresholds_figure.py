"""A figure that shows which thresholds matter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.recording.figure import COLORS, make_figure, style_axes

_LABELS = ("lower", "higher")


def draw(
    changes: Mapping[str, Sequence[Sequence[float]]], panels: Sequence[str]
) -> Any:
    """Draw what a lower and a higher value of each threshold change.

    Args:
        changes: By threshold, for the lower and the higher value, a number for each
            panel: first a count of scenes, 0 if none changes, then ratios, 1 if nothing
            changes.
        panels: Titles of the panels.
    """
    names = list(changes)
    figure = make_figure(
        11.0, 1.2 + 0.19 * len(names), "Effect of other values of thresholds"
    )
    all_axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    at = np.arange(len(names))
    for i, (axes, panel) in enumerate(zip(all_axes, panels, strict=True)):
        style_axes(axes)
        axes.set_title(panel, fontsize=8, loc="left")
        neutral = 0.0 if i == 0 else 1.0
        axes.axvline(neutral, color=COLORS[-1], lw=0.8)
        for k, label in enumerate(_LABELS):
            values = [tried[k][i] for tried in changes.values()]
            side = at + 0.18 * (2 * k - 1)
            axes.hlines(side, neutral, values, color=COLORS[k], lw=1.2)
            axes.plot(values, side, "o", ms=3.5, color=COLORS[k], label=label)
        axes.grid(axis="x", color="#c8ced6", lw=0.5)
    first = all_axes[0]
    first.set_yticks(at, names, fontsize=7.5)
    first.set_ylim(len(names) - 0.5, -0.5)
    first.legend(fontsize=8, frameon=False, loc="lower left")
    return figure
