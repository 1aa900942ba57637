"""The numbered files of a LeRobot data set."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

CHUNK_SIZE = 1000  # files per folder, as in LeRobot


class FilePlace(NamedTuple):
    """The place of a numbered file: the number of its folder and its own."""

    chunk: int
    file: int

    def path(self, folder: Path, suffix: str) -> Path:
        """Return the file's path."""
        return folder / f"chunk-{self.chunk:03d}" / f"file-{self.file:03d}{suffix}"


def next_place(place: FilePlace | None) -> FilePlace:
    """Return the place after another one, or the first place after None."""
    if place is None:
        return FilePlace(0, 0)
    if place.file + 1 < CHUNK_SIZE:
        return FilePlace(place.chunk, place.file + 1)
    return FilePlace(place.chunk + 1, 0)


class ParquetFiles:
    """Writes tables into Parquet files of limited size, one row group per table.

    The last file is complete after `close`.

    Args:
        folder: Folder for chunk-000/file-000.parquet and so on.
        schema: Schema of the tables.
        limit: Largest size of a file [bytes], counted in memory, where tables are
            larger; a table beyond the limit gets a file of its own.

    Raises:
        OSError: If a file cannot be written.
    """

    def __init__(self, folder: Path, schema: pa.Schema, limit: int):
        self._folder, self._schema, self._limit = folder, schema, limit
        self._place: FilePlace | None = None
        self._size = 0
        self._writer: Any = None

    def place(self, size: int) -> FilePlace:
        """Return the place of the next table, given its size in memory [bytes]."""
        if self._place is None or (self._size and self._size + size > self._limit):
            self.close()
            self._place = next_place(self._place)
            self._size = 0
        return self._place

    def append(self, table: pa.Table) -> FilePlace:
        """Append a table; returns its place."""
        place = self.place(table.nbytes)
        if self._writer is None:
            path = place.path(self._folder, ".parquet")
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = pq.ParquetWriter(path, self._schema, compression="snappy")
        self._writer.write_table(table)
        self._size += table.nbytes
        return place

    def close(self) -> None:
        """Complete the open file, if any."""
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()
