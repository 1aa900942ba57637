"""Files and folders that appear under their names only when they are complete.

Power may fail at any time: what has its name is on the disk. What has not been
completed has a name that ends in `.partial`, and is removed by whoever comes next.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path

_PARTIAL = ".partial"


def write_file(path: Path, content: bytes) -> None:
    """Write a file, over what was there, whole or not at all.

    Raises:
        OSError: If it cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = _partial(path)
    try:
        _write(partial, content)
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    _sync(path.parent)


def write_folder(path: Path, files: Path | Mapping[str, bytes]) -> None:
    """Write a folder of files, in place of what was there, whole or not at all.

    Args:
        path: The folder.
        files: Contents by name; or the folder that they are moved from.

    Raises:
        OSError: If it cannot be written.
    """
    partial = _partial(path)
    remove_folder(partial)
    try:
        partial.mkdir(parents=True)
        if isinstance(files, Path):
            for file in files.iterdir():
                shutil.move(file, partial / file.name)
                _sync(partial / file.name)
            files.rmdir()
        else:
            for name, content in files.items():
                _write(partial / name, content)
        _sync(partial)
        remove_folder(path)
        partial.replace(path)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    _sync(path.parent)


def remove_folder(path: Path) -> None:
    """Remove a folder and what is in it; where there is none, this does nothing.

    Raises:
        OSError: If it cannot be removed.
    """
    if path.exists():
        shutil.rmtree(path)


def remove_partial(folder: Path) -> None:
    """Remove what was not completed in a folder; nobody may be writing there.

    Raises:
        OSError: If something cannot be removed.
    """
    for path in folder.glob(f".*{_PARTIAL}"):
        if path.is_dir():
            remove_folder(path)
        else:
            path.unlink()


def _partial(path: Path) -> Path:
    return path.with_name(f".{path.name}{_PARTIAL}")


def _write(path: Path, content: bytes) -> None:
    with path.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _sync(path: Path) -> None:
    """Make a file's contents durable, or the names in a folder."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
