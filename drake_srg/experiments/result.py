"""The result of an experiment: judged rows, tables and a figure."""

from __future__ import annotations

import contextlib
import csv
import dataclasses as dc
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from drake_srg.recording.figure import save_png
from drake_srg.recording.output import OutputFile

# What the machine's speed does to a value: nothing, or it grows with a slower machine
# (a time), or it shrinks (a rate, such as a real-time factor).
Clock = Literal["", "time", "rate"]

# Default spreads as shares: of a value or its criterion, and of a wall-clock value.
_SHARE, _CLOCK_SHARE = 0.1, 0.5
# Units suit the values, so that a millionth of one is round-off [any unit].
_ROUND_OFF = 1e-6


@dc.dataclass(frozen=True)
class Row:
    """A measured quantity and its criterion.

    Make rows with the class methods, which compute `passed`. A measurement passes only
    if it is finite.

    Contact amplifies the last bits of a number, in which versions of Drake and
    processors differ. `spread` says how far the value may move for such reasons. By
    default, it is a tenth of the value or of its limit, whichever is larger, because a
    change far below a limit means nothing; for `within`, it is at most the allowed
    deviation; for a wall-clock value, it is at least half of the value.

    A row that is known not to meet its criterion says why (`known`). It still has not
    passed, and its value is watched like any other, but the experiment does not fail.

    Attributes:
        name: The object, driver or setting that was measured.
        quantity: The measured quantity.
        expected: The criterion as text, such as `<= 3`.
        measured: The measured value.
        unit: Of the value, of the criterion and of the spread.
        passed: Whether the value meets the criterion.
        spread: How far the value may move from one run to another before somebody must
            look into it.
        clock: How the value depends on the machine's speed. The ratio of two times of
            one run does not depend on it.
        known: Why the row does not meet its criterion, where that is known.
    """

    name: str
    quantity: str
    expected: str
    measured: float
    unit: str
    passed: bool
    spread: float
    clock: Clock = ""
    known: str = ""

    @property
    def fails(self) -> bool:
        """Whether the row misses its criterion for no known reason."""
        return not (self.passed or self.known)

    @classmethod
    def at_most(
        cls,
        name: str,
        quantity: str,
        limit: float,
        measured: float,
        unit: str,
        *,
        spread: float | None = None,
        clock: Clock = "",
    ) -> Row:
        """Return a row that expects no more than `limit`."""
        if spread is None:
            spread = _default_spread(clock, measured, limit)
        text, passed = f"<= {limit:.4g}", measured <= limit
        return cls._judged(name, quantity, text, measured, unit, passed, spread, clock)

    @classmethod
    def at_least(
        cls,
        name: str,
        quantity: str,
        limit: float,
        measured: float,
        unit: str,
        *,
        spread: float | None = None,
        clock: Clock = "",
    ) -> Row:
        """Return a row that expects no less than `limit`."""
        if spread is None:
            spread = _default_spread(clock, measured, limit)
        text, passed = f">= {limit:.4g}", measured >= limit
        return cls._judged(name, quantity, text, measured, unit, passed, spread, clock)

    @classmethod
    def within(
        cls,
        name: str,
        quantity: str,
        expected: float,
        measured: float,
        unit: str,
        *,
        relative: float = 0.0,
        absolute: float = 0.0,
        spread: float | None = None,
    ) -> Row:
        """Return a row that expects a value up to a relative or absolute deviation.

        If both deviations are given, the larger one counts.
        """
        allowed = max(relative * abs(expected), absolute)
        if spread is None:
            spread = allowed
            if expected != 0.0:
                spread = min(allowed, _default_spread("", measured, expected))
        text = f"{expected:.4g} +- {allowed:.2g}"
        passed = abs(measured - expected) <= allowed
        return cls._judged(name, quantity, text, measured, unit, passed, spread)

    @classmethod
    def info(
        cls,
        name: str,
        quantity: str,
        measured: float,
        unit: str,
        *,
        spread: float | None = None,
        clock: Clock = "",
    ) -> Row:
        """Return an informative row, which passes with any finite number."""
        if spread is None:
            spread = _default_spread(clock, measured)
        text = "a number"
        return cls._judged(name, quantity, text, measured, unit, True, spread, clock)

    @classmethod
    def _judged(
        cls,
        name: str,
        quantity: str,
        expected: str,
        measured: float,
        unit: str,
        passed: bool,
        spread: float,
        clock: Clock = "",
    ) -> Row:
        passed = bool(passed) and math.isfinite(measured)
        spread = max(float(spread), _ROUND_OFF)
        value = float(measured)
        return cls(name, quantity, expected, value, unit, passed, spread, clock)

    def because(self, reason: str) -> Row:
        """Return the row with the known reason why it misses its criterion."""
        return dc.replace(self, known=reason)

    def as_dict(self) -> dict[str, str | float | bool | None]:
        """Return the row as in result.json; values that are not finite become None."""
        values: dict[str, str | float | bool | None] = {
            "name": self.name,
            "quantity": self.quantity,
            "expected": self.expected,
            "measured": self.measured if math.isfinite(self.measured) else None,
            "unit": self.unit,
            "pass": self.passed,
            "spread": self.spread if math.isfinite(self.spread) else None,
            "clock": self.clock,
        }
        return values | ({"known": self.known} if self.known else {})

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Row:
        """Return a row of result.json; a measured None becomes NaN, a spread infinite.

        Raises:
            KeyError: If an entry is missing.
        """
        measured, spread = values["measured"], values["spread"]
        return cls(
            values["name"],
            values["quantity"],
            values["expected"],
            math.nan if measured is None else measured,
            values["unit"],
            values["pass"],
            math.inf if spread is None else spread,
            values["clock"],
            values.get("known", ""),
        )


def _default_spread(clock: Clock, measured: float, limit: float = 0.0) -> float:
    """Return a share of the larger of value and limit; infinities do not count."""
    sizes = [abs(v) for v in (measured, limit) if math.isfinite(v)]
    spread = _SHARE * max(sizes, default=0.0)
    if clock and math.isfinite(measured):
        spread = max(spread, _CLOCK_SHARE * abs(measured))
    return spread


@dc.dataclass(frozen=True)
class ExperimentResult:
    """The result of an experiment.

    Attributes:
        rows: The judged quantities; at least one.
        tables: The data behind the figure: columns by name of a CSV file. Columns are
            values by name (with the unit), equally long.
        figure: From `recording.figure.make_figure`.
        files: Text of other files, such as a calibration, by name.

    Raises:
        ValueError: If there are no rows, or if columns of a table differ in length.
    """

    rows: Sequence[Row]
    tables: Mapping[str, Mapping[str, npt.ArrayLike]]
    figure: Any
    files: Mapping[str, str] = dc.field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.rows:
            raise ValueError("rows: must not be empty")
        for table, columns in self.tables.items():
            shapes = {name: np.shape(values) for name, values in columns.items()}
            if len(set(shapes.values())) != 1 or {1} != set(map(len, shapes.values())):
                raise ValueError(
                    f"table {table!r}: columns must have the same length, got {shapes}"
                )

    @property
    def passed(self) -> bool:
        """Whether no row fails."""
        return not any(row.fails for row in self.rows)

    def table(self) -> str:
        """Return the rows as aligned text."""
        lines = [("", "name", "quantity", "measured", "unit", "expected")]
        for row in self.rows:
            word = "ok" if row.passed else "FAIL" if row.fails else "known"
            measured = f"{row.measured:.4g}"
            lines.append(
                (word, row.name, row.quantity, measured, row.unit, row.expected)
            )
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        return "\n".join(
            "  ".join(map(str.ljust, line, widths)).rstrip() for line in lines
        )

    def paths(self, name: str, out: Path) -> list[Path]:
        """Return the paths of the files that `write` writes."""
        tables = (f"{table}.csv" for table in self.tables)
        files = ("result.json", *tables, *self.files, f"{name}.png")
        return [out / file for file in files]

    def write(self, name: str, out: Path) -> list[Path]:
        """Write result.json, tables, files and NAME.png: all of them or none.

        Equal results give equal bytes.

        Returns:
            The paths, as from `paths`.

        Raises:
            OSError: If they cannot be written.
        """
        with contextlib.ExitStack() as stack:
            outputs = [OutputFile(path) for path in self.paths(name, out)]
            for output in outputs:
                stack.callback(output.discard)
            report, *others, picture = outputs
            tables, files = others[: len(self.tables)], others[len(self.tables) :]
            text = json.dumps([row.as_dict() for row in self.rows], indent=2)
            report.path.write_text(text + "\n", encoding="utf-8")
            for table, columns in zip(tables, self.tables.values(), strict=True):
                _write_csv(table.path, columns)
            for file, content in zip(files, self.files.values(), strict=True):
                file.path.write_text(content, encoding="utf-8")
            save_png(self.figure, picture.path)
            return [output.commit() for output in outputs]


def _write_csv(path: Path, columns: Mapping[str, npt.ArrayLike]) -> None:
    """Write numbers with 9 digits, text as it is, and NaN as an empty field."""

    def show(value: Any) -> str:
        if isinstance(value, float):
            return "" if math.isnan(value) else f"{value:.9g}"
        return str(value)

    lists = [np.asarray(values).tolist() for values in columns.values()]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for row in zip(*lists, strict=True):
            writer.writerow([show(value) for value in row])
