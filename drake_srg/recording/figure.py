"""The style of all our figures, and their PNG files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from drake_srg.recording.output import OutputFile, require

# Distinct for colour-blind readers, too (M. Okabe, K. Ito, Color Universal Design).
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#333333")


def make_figure(
    width: float, height: float, title: str = "", *, layout: str | None = "constrained"
) -> Any:
    """Return an empty matplotlib Figure; it needs no display.

    Args:
        width: [inch].
        height: [inch].
        title: Text above the axes, on the left.
        layout: Of matplotlib; None for axes that are placed by hand.

    Raises:
        ImportError: If matplotlib is missing.
    """
    require("matplotlib.backends.backend_agg")
    figure = require("matplotlib.figure").Figure(
        figsize=(width, height), dpi=110, layout=layout
    )
    if title:
        figure.suptitle(title, x=0.01, ha="left", weight="bold")
    return figure


def style_axes(axes: Any, *, xlabel: str = "", ylabel: str = "") -> None:
    """Give axes our style and labels; call this before plotting and drawing legends."""
    axes.set_prop_cycle(color=COLORS)
    axes.set_xlabel(xlabel, fontsize=9)
    axes.set_ylabel(ylabel, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(axis="y", color="#c8ced6", lw=0.5)
    axes.spines[["top", "right"]].set_visible(False)


def save_png(figure: Any, path: Path | str) -> Path:
    """Write a figure, completely or not at all; equal figures give equal bytes.

    Raises:
        OSError: If the file cannot be written.
    """
    output = OutputFile(path)
    # matplotlib would write its version into the file.
    figure.savefig(output.path, format="png", metadata={"Software": None})
    return output.commit()
