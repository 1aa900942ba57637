"""The log that `drake-srg identify` reads: one row per press or heating test."""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Sequence
from importlib import resources
from itertools import pairwise
from pathlib import Path

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.tables import parse_table, read_table

VENDOR = "ezgripper.csv"
TESTS = ("position", "torque", "heating")
RISE = 5.0  # rise of the temperature in a heating row [K]
_RESOLUTION = 1.0  # of the temperature register [K]
COLUMNS = (
    *("test", "setpoint_pct", "load", "stop_counts"),
    *("current_ma", "seconds", "temperature_c"),
)
# Smallest and largest plausible value by column. Values outside have a wrong unit.
_RANGES = {
    "setpoint_pct": (1.0, 100.0),
    "load": (1.0, 1023.0),
    "stop_counts": (-28672.0, 28672.0),
    "current_ma": (10.0, 20000.0),
    "seconds": (0.01, 36000.0),
    "temperature_c": (-20.0, 100.0),
}
# Columns that a test needs besides the set point, and its smallest number of rows.
_NEEDED = {
    "position": (("load", "stop_counts", "current_ma"), 4),
    "torque": (("load", "stop_counts", "current_ma"), 4),
    "heating": (("current_ma", "seconds", "temperature_c"), 2),
}


@dc.dataclass(frozen=True)
class LogRow:
    """Register values of one test; values that were not measured are NaN.

    Attributes:
        test: `position`: the tips press against each other by position control;
            `torque`: by torque control; `heating`: by torque control for a long time.
        setpoint_pct: Limit of the PWM, goal torque or goal current [percent].
        load: PWM, 0 .. 1023.
        stop_counts: Position at which the spool stopped [counts]; smaller is more
            closed.
        current_ma: The servo's own estimate of its current [mA].
        seconds: Heating: time to warm by `RISE`; other tests: time until the stop was
            noticed [s].
        temperature_c: Temperature at the start of heating [degC].
        before_ma: Heating: current before the start, if this row continues the row
            before [mA]; NaN: the motor has rested.
    """

    test: str
    setpoint_pct: float
    load: float = math.nan
    stop_counts: float = math.nan
    current_ma: float = math.nan
    seconds: float = math.nan
    temperature_c: float = math.nan
    before_ma: float = math.nan

    @property
    def label(self) -> str:
        """The test and its set point."""
        return f"{self.test} {self.setpoint_pct:g} %"


def vendor_log() -> list[LogRow]:
    """Return the vendor's rows, which ship with the package."""
    text = resources.files(__package__).joinpath(VENDOR).read_text(encoding="utf-8")
    return parse_log(text, VENDOR)


def read_log(path: Path) -> list[LogRow]:
    """Return the rows of a CSV file; lines that start with # are comments.

    Raises:
        ScenarioError: If the file cannot be read or is not a complete log.
    """
    return _rows(read_table(path, COLUMNS, only=True), str(path))


def parse_log(text: str, name: str) -> list[LogRow]:
    """Return the rows of a log.

    Raises:
        ScenarioError: If a column is missing or unknown, a value is missing or out of
            range, or a test has too few rows.
    """
    return _rows(parse_table(text, name, COLUMNS, only=True), name)


def log_text(rows: Sequence[LogRow]) -> str:
    """Return rows as the text of a log, which `parse_log` reads."""
    lines = [",".join(COLUMNS)]
    for row in rows:
        values = [getattr(row, column) for column in COLUMNS]
        cells = (v if isinstance(v, str) else _cell(v) for v in values)
        lines.append(",".join(cells))
    return "\n".join(lines) + "\n"


def _cell(value: float) -> str:
    return "" if math.isnan(value) else f"{round(value, 3)}"


def _rows(table: list[tuple[str, dict[str, str]]], name: str) -> list[LogRow]:
    rows = [_row(entries, where) for where, entries in table]
    rows[1:] = [_continued(row, before) for before, row in pairwise(rows)]
    for test, (_, fewest) in _NEEDED.items():
        found = sum(row.test == test for row in rows)
        if found < fewest:
            raise ScenarioError(
                f"{name}: test {test}: needs at least {fewest} rows, got {found}"
            )
    return rows


def _continued(row: LogRow, before: LogRow) -> LogRow:
    """Return a row with the current of the row before, if it continues that row."""
    if not row.test == before.test == "heating":
        return row
    if abs(row.temperature_c - before.temperature_c - RISE) > _RESOLUTION:
        return row
    return dc.replace(row, before_ma=before.current_ma)


def _row(entries: dict[str, str], where: str) -> LogRow:
    test = entries["test"]
    if test not in TESTS:
        raise ScenarioError(
            f"{where}: test: must be one of {', '.join(TESTS)}; got {test!r}"
        )
    numbers = {}
    for column, (low, high) in _RANGES.items():
        text = entries[column]
        if not text:
            if column == "setpoint_pct" or column in _NEEDED[test][0]:
                raise ScenarioError(f"{where}: {column}: must not be empty for {test}")
            continue
        try:
            value = float(text)
        except ValueError:
            raise ScenarioError(
                f"{where}: {column}: must be a number without a unit, got {text!r}"
            ) from None
        if not low <= value <= high:  # NaN is outside, too
            raise ScenarioError(
                f"{where}: {column}: must be {low:g} .. {high:g}, got {text}"
            )
        numbers[column] = value
    return LogRow(test, **numbers)
