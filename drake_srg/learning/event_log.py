"""Scalars in TensorBoard's format, written without TensorBoard.

A file is a sequence of records (TFRecord): length, checksum, an `Event` message of
Protocol Buffers, checksum. TensorBoard's event.proto and summary.proto number the
fields.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType

_POLYNOMIAL = 0x82F63B78  # CRC-32C (Castagnoli), reflected


def _table() -> list[int]:
    table = []
    for byte in range(256):
        for _ in range(8):
            byte = (byte >> 1) ^ (_POLYNOMIAL if byte & 1 else 0)  # noqa: PLW2901 a register
        table.append(byte)
    return table


_TABLE = _table()


class EventLog:
    """Appends to an event file; use it as a context manager.

    Args:
        folder: Where TensorBoard looks for it.

    Raises:
        OSError: If it cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._file = (folder / "events.out.tfevents.drake_srg").open("ab")
        if not self._file.tell():
            self._write(_text(3, "brain.Event:2"))

    def add(self, step: int, values: Mapping[str, float]) -> None:
        """Append scalars by name, as of a step of training."""
        summary = b"".join(
            _bytes(1, _text(1, name) + b"\x15" + struct.pack("<f", value))
            for name, value in values.items()
        )
        self._write(b"\x10" + _varint(step) + _bytes(5, summary))

    def __enter__(self) -> EventLog:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._file.close()

    def _write(self, event: bytes) -> None:
        event = b"\x09" + struct.pack("<d", time.time()) + event
        length = struct.pack("<Q", len(event))
        record = length + _checksum(length) + event + _checksum(event)
        self._file.write(record)
        self._file.flush()


def crc32c(data: bytes) -> int:
    """Return the CRC-32C of bytes (RFC 3720, appendix B.4)."""
    register = 0xFFFFFFFF
    for byte in data:
        register = _TABLE[(register ^ byte) & 0xFF] ^ (register >> 8)
    return register ^ 0xFFFFFFFF


def _checksum(data: bytes) -> bytes:
    """Return the masked checksum of a TFRecord."""
    crc = crc32c(data)
    masked = ((crc >> 15) | (crc << 17)) + 0xA282EAD8
    return struct.pack("<I", masked & 0xFFFFFFFF)


def _varint(value: int) -> bytes:
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def _bytes(field: int, data: bytes) -> bytes:
    """Return a field of a message that has a length."""
    return bytes([field << 3 | 2]) + _varint(len(data)) + data


def _text(field: int, text: str) -> bytes:
    return _bytes(field, text.encode())
