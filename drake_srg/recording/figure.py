"""The style that all our figures have, and PNG files of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from drake_srg.recording.output import OutputFile, require

# Told apart by colour-blind people, too (M. Okabe, K. Ito, Color Universal Design).
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#333333")


def make_figure(width: float, height: float, title: str = "") -> Any:
    """Return an empty matplotlib Figure of a size in inches; no display is needed.

    Raises:
        ImportError: If matplotlib is missing.
    """
    require("matplotlib.backends.backend_agg")
    figure = require("matplotlib.figure").Figure(
        figsize=(width, height), dpi=110, layout="constrained"
    )
    if title:
        figure.suptitle(title, x=0.01, ha="left", weight="bold")
    return figure


def style_axes(axes: Any, *, xlabel: str = "", ylabel: str = "") -> None:
    """Give axes our style and labels; call it before drawing legends."""
    axes.set_prop_cycle(color=COLORS)
    axes.set_xlabel(xlabel, fontsize=9)
    axes.set_ylabel(ylabel, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(axis="y", color="#c8ced6", lw=0.5)
    axes.spines[["top", "right"]].set_visible(False)


def save_png(figure: Any, path: Path | str) -> Path:
    """Write a figure, whole or not at all; equal figures give equal bytes.

    Raises:
        OSError: If the file cannot be written.
    """
    output = OutputFile(path)
    # Without the version of matplotlib in it the file tells nothing but the data.
    figure.savefig(output.path, format="png", metadata={"Software": None})
    return output.commit()
