"""The result of an experiment: judged rows, tables and a figure."""

from __future__ import annotations

import contextlib
import csv
import dataclasses as dc
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from drake_srg.experiments.row import Row
from drake_srg.recording.output import OutputFile
from drake_srg.recording.timeline import save_png


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
