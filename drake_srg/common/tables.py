"""Strict readers of users' JSON and CSV files, which refuse ambiguous content."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from drake_srg.common.exceptions import ScenarioError, one_line

T = TypeVar("T")


def read_json(path: Path, build: Callable[[Any], T]) -> T:
    """Return a function's result for the content of a JSON file.

    Args:
        path: The file.
        build: Takes the parsed content. A ValueError, KeyError or TypeError means that
            it is invalid.

    Raises:
        ScenarioError: If the file cannot be read, has a key twice, or is invalid.
    """
    try:
        text = path.read_text(encoding="utf-8")
        return build(parse_json(text))
    except ScenarioError:
        raise
    except OSError as error:
        reason = error.strerror or one_line(error)
        raise ScenarioError(f"{path}: cannot be read: {reason}") from None
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ScenarioError(f"{path}: invalid content: {one_line(error)}") from None


def parse_json(text: str) -> Any:
    """Return the content of a text in JSON.

    Raises:
        ValueError: If it is not JSON, or has a key twice.
    """
    return json.loads(text, object_pairs_hook=_unique)


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"key {twice!r} twice")
    return found


def read_table(
    path: Path, columns: Sequence[str], *, only: bool = False
) -> list[tuple[str, dict[str, str]]]:
    """Return the rows of a CSV file; lines that start with # are comments.

    Args:
        path: The file.
        columns: Required columns.
        only: Whether other columns are forbidden.

    Returns:
        For each row: file and line, for error messages, and entries by column.

    Raises:
        ScenarioError: If it cannot be read, or lacks a column or an entry.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")  # spreadsheets write the BOM
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or "not a CSV file in UTF-8"
        raise ScenarioError(f"{path}: cannot be read: {reason}") from None
    return parse_table(text, str(path), columns, only=only)


def parse_table(
    text: str, name: str, columns: Sequence[str], *, only: bool = False
) -> list[tuple[str, dict[str, str]]]:
    """Return the rows of a text in CSV; see `read_table`.

    Args:
        text: The text.
        name: Its file, for error messages.
        columns: Required columns.
        only: Whether other columns are forbidden.
    """
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.startswith("#")
    ]
    reader = csv.reader(line for _, line in lines)
    rows = []
    try:
        header = [cell.strip() for cell in next(reader, [])]
        _check_header(header, name, columns)
        if only and (others := [c for c in header if c not in columns]):
            allowed = ", ".join(columns)
            raise ScenarioError(
                f"{name}: unknown column {others[0]} (columns: {allowed})"
            )
        for cells in reader:
            where = f"{name}: line {lines[reader.line_num - 1][0]}"
            if len(cells) != len(header):
                needed = f"needs {len(header)} entries, got {len(cells)}"
                raise ScenarioError(f"{where}: {needed}")
            entries = [cell.strip() for cell in cells]
            rows.append((where, dict(zip(header, entries, strict=True))))
    except csv.Error as error:
        raise ScenarioError(f"{name}: not a CSV file: {error}") from None
    return rows


def _check_header(header: Sequence[str], name: str, columns: Sequence[str]) -> None:
    allowed = f"(columns: {', '.join(columns)})"
    for column in header:
        if header.count(column) > 1:
            raise ScenarioError(f"{name}: column {column} twice {allowed}")
    missing = [column for column in columns if column not in header]
    if missing:
        for separator in (";", "\t"):
            if len(header) == 1 and separator in header[0]:
                raise ScenarioError(
                    f"{name}: entries are separated by {separator!r}, must be by ','"
                )
        raise ScenarioError(f"{name}: missing column {missing[0]} {allowed}")
