"""The rows of a sweep: one a trial, in Parquet, by its own name until all are there.

    DIR/trials/000017.parquet    the row of trial 17, as it ends
    DIR/trials.parquet           all rows in order of trial, once the sweep is over

A row has `trial`, `seed`, what came of the trial, and what was drawn for it, by the key
that `--set` knows it by; these names have a dot, no other one has.
"""

from __future__ import annotations

import functools
import math
import re
import types
import typing
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.common.installing import require
from drake_srg.simulation.metrics import Metrics
from drake_srg.sweeps.files import write_file
from drake_srg.sweeps.info import SweepInfo, read_sweep

__all__ = [
    "TIMING_COLUMNS",
    "BrokenRowsError",
    "SweepInfo",
    "all_rows_path",
    "metric_columns",
    "read_file",
    "read_rows",
    "read_sweep",
    "require_sweep",
    "row_path",
    "row_paths",
    "sampled_columns",
    "unique_rows",
    "write_row",
    "write_rows",
]

# The only columns that differ where the same trial is run again.
TIMING_COLUMNS = (
    "planning_wall_s",
    "wall_time_s",
    "real_time_factor",
    "trial_time_s",  # all of the trial, build included
    "memory_mb",  # resident in the worker, after the trial
    "worker",
)

# What of metrics.json is no metric of a trial, or stands in the row anyway.
_NO_METRICS = ("schema_version", "scenario", "seed", "artifacts")

# In the metadata of a file's schema: see `_checksum`.
_CHECKSUM = b"drake_srg.crc32"

_ROW_FILE = re.compile(r"[0-9]{6,}\.parquet")  # see `row_path`


class BrokenRowsError(ScenarioError):
    """A file whose content is not the rows that it should hold."""

    def __init__(self, path: Path, reason: str):
        self.problem = f"{path}: cannot be read: {reason}"
        again = "`drake-srg sweep` with --resume runs its trial again"
        if path == all_rows_path(path.parent):  # too much to be lost unasked
            again = (
                "put a copy in its place, or move it away: `drake-srg sweep` with "
                "--resume runs its trials again then"
            )
        super().__init__(f"{self.problem}; {again}")


def require_sweep(module: str, extra: str = "sweep") -> ModuleType:
    """Import a module that sweeps need.

    Raises:
        ImportError: If it is missing; the message says how to install it.
    """
    return require(module, extra, "Sweeps need")


def row_path(folder: Path, trial: int) -> Path:
    """Return where the row of a trial is until all are there."""
    return folder / "trials" / f"{trial:06}.parquet"


def all_rows_path(folder: Path) -> Path:
    """Return where all rows are in the end."""
    return folder / "trials.parquet"


def row_paths(folder: Path) -> list[Path]:
    """Return the files with rows that are there, that of all rows first.

    Raises:
        ScenarioError: If a folder cannot be read.
    """
    # Single rows go once all are in one file: looked for first, none is missed.
    # Copies and the like that others put there are none of ours.
    single = [n for n in _names(folder / "trials") if _ROW_FILE.fullmatch(n)]
    whole = all_rows_path(folder)
    paths = [folder / "trials" / name for name in sorted(single)]
    return [whole, *paths] if whole.name in _names(folder) else paths


def _names(folder: Path) -> list[str]:
    """What is in a folder; `Path.glob` takes one that cannot be read for empty."""
    try:
        return [path.name for path in folder.iterdir()]
    except FileNotFoundError:
        return []
    except OSError as error:
        raise _unreadable(folder, error) from error


def _unreadable(path: Path, error: OSError) -> ScenarioError:
    return ScenarioError(f"{path}: cannot be read: {error.strerror or one_line(error)}")


def metric_columns() -> dict[str, Any]:
    """Return the columns of metrics, and Python's type of each."""
    hints = typing.get_type_hints(Metrics)
    return {name: hint for name, hint in hints.items() if name not in _NO_METRICS}


def sampled_columns(table: Any) -> list[str]:
    """Return the names of the columns that hold what was drawn.

    Args:
        table: A pyarrow.Table of `read_rows`.
    """
    return [name for name in table.column_names if "." in name]


def read_rows(folder: Path) -> Any:
    """Return the rows that a sweep has so far, each trial once, in their order.

    Returns:
        A pyarrow.Table. Without rows it still has the columns that all sweeps have.

    Raises:
        ScenarioError: If there is no sweep, a file cannot be read, or what is in it is
            broken (BrokenRowsError).
        ImportError: If pyarrow is missing.
    """
    info = read_sweep(folder)
    paths = row_paths(folder)
    while True:
        try:
            return unique_rows([read_file(path, info) for path in paths])
        except ScenarioError:
            before, paths = paths, row_paths(folder)
            if set(before) <= set(paths):  # else the sweep puts its rows into one file
                raise


def unique_rows(tables: Sequence[Any]) -> Any:
    """Return the rows of pyarrow Tables as one, each trial once, in their order.

    A trial that is there twice is the same both times; its first row is taken.
    """
    pa = require_sweep("pyarrow")
    empty = pa.schema(list(_types().items())).empty_table()
    rows = pa.concat_tables([empty, *tables], promote_options="permissive")
    first: dict[int, int] = {}
    for index, trial in enumerate(rows["trial"].to_pylist()):
        first.setdefault(trial, index)
    rows = rows.take(pa.array([first[trial] for trial in sorted(first)], pa.int64()))
    fixed = [name for name in rows.column_names if name in _types()]
    return rows.select(fixed + sorted(set(rows.column_names) - set(fixed)))


def read_file(path: Path, info: SweepInfo) -> Any:
    """Return the rows in a file, as a pyarrow.Table.

    Raises:
        BrokenRowsError: If it is not a file of rows of this sweep.
        ScenarioError: If the operating system does not let it be read.
    """
    pa, pq = require_sweep("pyarrow"), require_sweep("pyarrow.parquet")
    try:
        # Not by PyArrow, of whose errors it would be hard to say whose fault they are.
        content = pa.BufferReader(path.read_bytes())
    except OSError as error:
        raise _unreadable(path, error) from error
    try:
        with pq.ParquetFile(content, page_checksum_verification=True) as file:
            table = file.read(use_threads=False)
        trials = table["trial"].to_pylist()
        seeds = table["seed"].to_pylist()
        checksum = (table.schema.metadata or {}).get(_CHECKSUM)
        if checksum not in (None, _checksum(table)):
            raise ValueError("its checksum is another")
    except (pa.lib.ArrowException, OSError, ValueError, KeyError, TypeError) as error:
        raise BrokenRowsError(path, one_line(error)) from None
    if path != all_rows_path(path.parent) and trials != [int(path.stem)]:
        raise BrokenRowsError(path, "it does not hold the row of its trial")
    if seeds != [info.seed + trial for trial in trials]:
        raise BrokenRowsError(
            path, f"its seeds are not those of a sweep from {info.seed}"
        )
    return table


def write_row(path: Path, row: Mapping[str, Any]) -> None:
    """Write one row, whole or not at all. What is not finite becomes null.

    Raises:
        OSError: If it cannot be written.
    """
    pa = require_sweep("pyarrow")
    columns = {
        name: pa.array([_finite(value)], type=_types().get(name))
        for name, value in row.items()
    }
    write_rows(path, pa.table(columns))


def write_rows(path: Path, table: Any) -> None:
    """Write a pyarrow.Table, whole or not at all.

    Raises:
        OSError: If it cannot be written.
    """
    stream = require_sweep("pyarrow").BufferOutputStream()
    table = table.replace_schema_metadata({_CHECKSUM: _checksum(table)})
    require_sweep("pyarrow.parquet").write_table(
        table, stream, write_page_checksum=True
    )
    write_file(path, stream.getvalue().to_pybytes())


def _checksum(table: Any) -> bytes:
    """Of names, types and values: Parquet has a checksum of its pages alone."""
    types = list(map(str, table.schema.types))
    return b"%08x" % zlib.crc32(repr((types, table.to_pydict())).encode())


@functools.cache
def _types() -> dict[str, Any]:
    """Arrow's type of each column that all sweeps have, in their order."""
    pa = require_sweep("pyarrow")
    arrow = {
        bool: pa.bool_(),
        int: pa.int64(),
        float: pa.float64(),
        str: pa.string(),
        # The field's name is Parquet's: types are the same once they are read.
        list[float]: pa.list_(pa.field("element", pa.float64())),
    }
    hints: dict[str, Any] = {
        "trial": int,
        "seed": int,
        "success": bool,
        "failure": str,
        "message": str,
        "claimed": bool,
        **metric_columns(),
        "trial_time_s": float,
        "memory_mb": float,
        "worker": str,
    }
    return {name: arrow[_not_none(hint)] for name, hint in hints.items()}


def _not_none(hint: Any) -> Any:
    """`T` of the type `T | None`."""
    if isinstance(hint, types.UnionType):
        (hint,) = (part for part in typing.get_args(hint) if part is not type(None))
    return hint


def _finite(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return [_finite(x) for x in value] if isinstance(value, list) else value
