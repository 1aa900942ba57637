"""Logs: arrays in one .npz file, the same bytes for the same arrays."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from drake_srg.recording.output import OutputFile

# The oldest date that a zip file can hold: equal logs must not differ by their date.
_DATE = (1980, 1, 1, 0, 0, 0)


def write_log(path: Path | str, arrays: Mapping[str, npt.ArrayLike]) -> Path:
    """Write arrays so that `numpy.load` and `read_log` can read them.

    The file is replaced in one step, never half written. Names are stored in
    alphabetical order and with a fixed date, so equal arrays give equal files.

    Args:
        path: The .npz file.
        arrays: Arrays of numbers or strings, by name.

    Returns:
        The path.

    Raises:
        ValueError: If an array holds Python objects.
        OSError: If the file cannot be written.
    """
    output = OutputFile(path)
    with zipfile.ZipFile(output.path, "w") as archive:
        for name in sorted(arrays):
            array = np.asarray(arrays[name])
            if array.dtype.hasobject:
                raise ValueError(
                    f"log array {name!r} must hold numbers or strings, got dtype "
                    f"{array.dtype}"
                )
            entry = zipfile.ZipInfo(f"{name}.npy", _DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(entry, "w", force_zip64=True) as file:
                np.lib.format.write_array(file, array, allow_pickle=False)
    return output.commit()


def read_log(path: Path | str) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of a log, by name.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If it is not a log.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            return dict(archive)
    except (zipfile.BadZipFile, EOFError) as error:  # the file is cut off
        raise ValueError(f"{path}: {error}") from error
