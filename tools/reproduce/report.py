"""What a rerun found, for people."""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Sequence

from drake_srg.experiments.row import Row
from reproduce.compare import Change, compare, slowdown


@dc.dataclass
class Report:
    """What became of the experiments that were to be run.

    Attributes:
        changes: Rows that somebody must look into, by experiment.
        missing: Why there is no result, by experiment.
        uncommitted: Experiments that have no committed result yet.
        slowdowns: How many times as long experiments took as the committed run, for
            those that measure it.
        accepted: Whether the new figures are the committed ones by now.
    """

    changes: dict[str, list[Change]] = dc.field(default_factory=dict)
    missing: dict[str, str] = dc.field(default_factory=dict)
    uncommitted: list[str] = dc.field(default_factory=list)
    slowdowns: dict[str, float] = dc.field(default_factory=dict)
    accepted: bool = False

    def add(self, name: str, old: Sequence[Row] | None, new: Sequence[Row]) -> None:
        """Compare the rows of an experiment with the committed ones, if any."""
        self.changes[name] = compare(old, new)
        if old is None:
            self.uncommitted.append(name)
        elif any(row.clock for row in new):
            self.slowdowns[name] = slowdown(old, new)

    @property
    def good(self) -> bool:
        """Whether all experiments ran, all rows pass and the docs are up to date."""
        wrong = {c.what for changes in self.changes.values() for c in changes}
        if self.accepted:
            return not (self.missing or "failed" in wrong)
        return not (self.missing or self.uncommitted or wrong)

    def text(self) -> str:
        """Return the report as text."""
        lines = [table(self.changes)] if any(self.changes.values()) else []
        lines += [
            f"{name}: took {factor:.2f} times as long as the committed run, by which "
            "its wall-clock values are corrected"
            for name, factor in self.slowdowns.items()
        ]
        lines += [f"{name}: NOT RUN: {error}" for name, error in self.missing.items()]
        if not self.accepted:
            lines += [f"{name}: no committed result yet" for name in self.uncommitted]
        rows = sum(map(len, self.changes.values()))
        total = len(self.changes) + len(self.missing)
        lines.append(
            f"{len(self.changes)} of {total} experiments ran; {rows} rows "
            f"{'failed or changed' if rows else 'changed by more than their spread'}"
        )
        if self.accepted:
            lines.append("the new figures are in docs now: look at them, then commit")
        elif rows or self.uncommitted:
            lines.append("ACCEPT=1 puts the new figures into docs")
        return "\n".join(lines)


def table(changes: dict[str, list[Change]]) -> str:
    """Return changed rows, by experiment, as aligned text."""
    lines = [("experiment", "row", "quantity", "old", "new", "spread", "unit", "")]
    lines += [
        (
            name,
            change.row.name,
            change.row.quantity,
            _number(change.old),
            _number(change.new),
            f"{change.row.spread:.2g}",
            change.row.unit,
            change.what + (f": {change.row.expected}" * (change.what == "failed")),
        )
        for name in changes
        for change in changes[name]
    ]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)


def _number(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else "-"
