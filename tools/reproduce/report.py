"""What a rerun found, for people."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from reproduce.compare import Change


def table(changes: Mapping[str, Sequence[Change]]) -> str:
    """Return what changed, by experiment, as aligned text; empty if nothing did."""
    lines = [
        ("experiment", "row", "quantity", "old", "new", "spread", "unit", ""),
        *(
            (
                name,
                change.row.name,
                change.row.quantity,
                _number(change.old),
                _number(change.new),
                f"{change.row.spread:.2g}",
                change.row.unit,
                f"{change.what}, {change.row.expected}"
                if change.what == "failed"
                else change.what,
            )
            for name in changes
            for change in changes[name]
        ),
    ]
    if len(lines) == 1:
        return ""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)


def _number(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else "-"
