"""The rows of a sweep, one per trial, and their Parquet files.

    DIR/trials/000017.parquet    the row of trial 17, written when it ends
    DIR/trials.parquet           all rows in order of trial, once all have ended

A row has `trial`, `seed`, the outcome, and each value that was drawn for the trial,
named by its key for `--set`. Only the names of drawn values contain a dot.
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

# Only these columns differ when the same trial runs again.
TIMING_COLUMNS = (
    "planning_wall_s",
    "wall_time_s",
    "real_time_factor",
    "trial_time_s",  # of the whole trial, including building the cell
    "memory_mb",  # resident memory of the worker, after the trial
    "worker",
)

# Entries of metrics.json that are not columns of metrics.
_NO_METRICS = (
    *("schema_version", "scenario", "seed", "artifacts"),
    *("objects", "safety_stops", "off_table", "kinds"),
)

# A key in the metadata of a file's schema; see `_checksum`.
_CHECKSUM = b"drake_srg.crc32"

_ROW_FILE = re.compile(r"[0-9]{6,}\.parquet")  # see `row_path`


class BrokenRowsError(ScenarioError):
    """A file does not contain the rows that it should.

    Attributes:
        problem: The message without advice.
    """

    def __init__(self, path: Path, reason: str):
        self.problem = f"{path}: cannot be read: {reason}"
        advice = "`drake-srg sweep` with --resume runs its trial again"
        if path == all_rows_path(path.parent):  # too many rows to discard unasked
            advice = (
                "replace it with a copy, or move it away so that `drake-srg sweep` "
                "with --resume runs its trials again"
            )
        super().__init__(f"{self.problem}; {advice}")


def require_sweep(module: str, extra: str = "sweep") -> ModuleType:
    """Import a module that sweeps need, from one of the package's extras.

    Raises:
        ImportError: If the module is missing; the message says how to install it.
    """
    return require(module, extra, "Sweeps need")


def row_path(folder: Path, trial: int) -> Path:
    """Return the path of a trial's row while the sweep runs."""
    return folder / "trials" / f"{trial:06}.parquet"


def all_rows_path(folder: Path) -> Path:
    """Return the path of all rows, once all trials have ended."""
    return folder / "trials.parquet"


def row_paths(folder: Path) -> list[Path]:
    """Return the files with rows, the file of all rows first.

    Raises:
        ScenarioError: If a folder cannot be read.
    """
    # Single rows disappear once all are in one file. Look for them first, so that none
    # is missed. Other files, such as copies that somebody made, do not count.
    single = [n for n in _names(folder / "trials") if _ROW_FILE.fullmatch(n)]
    whole = all_rows_path(folder)
    paths = [folder / "trials" / name for name in sorted(single)]
    return [whole, *paths] if whole.name in _names(folder) else paths


def _names(folder: Path) -> list[str]:
    """Return the names in a folder; `Path.glob` treats an unreadable one as empty."""
    try:
        return [path.name for path in folder.iterdir()]
    except FileNotFoundError:
        return []
    except OSError as error:
        raise _unreadable(folder, error) from error


def _unreadable(path: Path, error: OSError) -> ScenarioError:
    return ScenarioError(f"{path}: cannot be read: {error.strerror or one_line(error)}")


def metric_columns() -> dict[str, Any]:
    """Return the columns of metrics, and the Python type of each."""
    hints = typing.get_type_hints(Metrics)
    return {name: hint for name, hint in hints.items() if name not in _NO_METRICS}


def sampled_columns(table: Any) -> list[str]:
    """Return the names of the columns of `read_rows` that contain drawn values."""
    return [name for name in table.column_names if "." in name]


def read_rows(folder: Path) -> Any:
    """Return the rows of a sweep's finished trials, each trial once, in order.

    Returns:
        A pyarrow.Table. Even without rows, it has the columns that all sweeps share.

    Raises:
        ScenarioError: If there is no sweep, a file cannot be read, or its content is
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
            # If files have gone, the sweep has just put its rows into one file.
            if set(before) <= set(paths):
                raise


def unique_rows(tables: Sequence[Any]) -> Any:
    """Return the rows of pyarrow Tables as one, each trial once, in order of trial.

    Rows of the same trial are equal; the first one is taken.
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
        BrokenRowsError: If its content is not rows of this sweep.
        ScenarioError: If the operating system cannot read it.
    """
    pa, pq = require_sweep("pyarrow"), require_sweep("pyarrow.parquet")
    try:
        # Read the file first: PyArrow's errors do not tell broken from unreadable.
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
            raise ValueError("checksum mismatch")
    except (pa.lib.ArrowException, OSError, ValueError, KeyError, TypeError) as error:
        raise BrokenRowsError(path, one_line(error)) from None
    if path != all_rows_path(path.parent) and trials != [int(path.stem)]:
        raise BrokenRowsError(path, f"contains trials {trials}")
    if seeds != [info.seed + trial for trial in trials]:
        raise BrokenRowsError(
            path, f"contains seeds that do not belong to a sweep from {info.seed}"
        )
    return table


def write_row(path: Path, row: Mapping[str, Any]) -> None:
    """Write one row completely or not at all; numbers that are not finite become null.

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
    """Write a pyarrow.Table completely or not at all.

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
    """Return a checksum of names, types and values; Parquet's covers only its pages."""
    types = list(map(str, table.schema.types))
    return b"%08x" % zlib.crc32(repr((types, table.to_pydict())).encode())


@functools.cache
def _types() -> dict[str, Any]:
    """Return the Arrow types of the columns that all sweeps share, in order."""
    pa = require_sweep("pyarrow")
    arrow = {
        bool: pa.bool_(),
        int: pa.int64(),
        float: pa.float64(),
        str: pa.string(),
        # With Parquet's own field name, the type is the same when read back.
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
    """Return `T` for the type `T | None`."""
    if isinstance(hint, types.UnionType):
        (hint,) = (part for part in typing.get_args(hint) if part is not type(None))
    return hint


def _finite(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return [_finite(x) for x in value] if isinstance(value, list) else value
