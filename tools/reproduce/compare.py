"""Compares the rows of two runs of an experiment."""

from __future__ import annotations

import dataclasses as dc
import math
from collections import Counter
from collections.abc import Sequence
from typing import Literal

import numpy as np

from drake_srg.experiments.row import Row


@dc.dataclass(frozen=True)
class Change:
    """A row that somebody must look into.

    Attributes:
        what: What is wrong with it. A row that fails may have moved as well.
        row: The new row, or the old one if it has vanished.
        old: The committed value; NaN if there is none.
        new: The new value, of a wall-clock row as if measured at the speed of the
            machine that made the committed one; NaN if there is none.
    """

    what: Literal["failed", "moved", "appeared", "vanished"]
    row: Row
    old: float
    new: float


def compare(old: Sequence[Row] | None, new: Sequence[Row]) -> list[Change]:
    """Return what changed by more than its spread, appeared, vanished or fails.

    A row with a known reason to miss its criterion does not fail, but may move.

    Rows are the same if they agree in name, quantity and unit; of several such rows,
    the first belongs to the first. The spread that counts is the committed one.

    Args:
        old: The committed rows; None if there are none.
        new: The rows of this run.
    """
    before, after = keyed(old or ()), keyed(new)
    slower = slowdown(old or (), new)
    changes = []
    for key in {**before, **after}:
        was, row = before.get(key), after.get(key)
        if row is None:
            assert was is not None
            changes.append(Change("vanished", was, was.measured, math.nan))
            continue
        value = at_old_speed(row, slower)
        committed = was.measured if was else math.nan
        if row.fails:
            changes.append(Change("failed", row, committed, value))
        elif was is None:
            if old is not None:
                changes.append(Change("appeared", row, committed, value))
        elif moved(was, value):
            changes.append(Change("moved", was, committed, value))
    return changes


def keyed(rows: Sequence[Row]) -> dict[tuple[str, str, str, int], Row]:
    """Return rows by name, quantity, unit and a count of equal ones before."""
    seen: Counter[tuple[str, str, str]] = Counter()
    found = {}
    for row in rows:
        key = (row.name, row.quantity, row.unit)
        found[(*key, seen[key])] = row
        seen[key] += 1
    return found


def moved(old: Row, value: float) -> bool:
    """Return whether a row's new value differs by more than the old row's spread."""
    if not math.isfinite(old.measured):
        return math.isfinite(value)
    return not abs(value - old.measured) <= old.spread


def slowdown(old: Sequence[Row], new: Sequence[Row]) -> float:
    """Return how many times as long this run took as the committed one.

    This is the median over the wall-clock rows; 1 if there are none.
    """
    before, after = keyed(old), keyed(new)
    ratios = [
        after[key].measured / row.measured
        if row.clock == "time"
        else row.measured / after[key].measured
        for key, row in before.items()
        if key in after
        and row.clock
        and row.clock == after[key].clock
        and row.measured > 0.0
        and after[key].measured > 0.0
    ]
    return float(np.median(ratios)) if ratios else 1.0


def at_old_speed(row: Row, slower: float) -> float:
    """Return a row's value without the change of the machine's speed."""
    if row.clock == "time":
        return row.measured / slower
    return row.measured * slower if row.clock == "rate" else row.measured
