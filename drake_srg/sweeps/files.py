"""Files and folders that appear under their names only when complete.

Even after a power failure, a file with its final name is complete. Until then, its name
ends in `.partial`; the next process to use the folder removes such leftovers.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path

_PARTIAL = ".partial"


def write_file(path: Path, content: bytes) -> None:
    """Write a file completely or not at all, replacing an old one.

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
    sync(path.parent)


def write_folder(path: Path, files: Path | Mapping[str, bytes]) -> None:
    """Write a folder of files completely or not at all, replacing an old one.

    Args:
        path: The folder.
        files: Contents by name, or a folder whose files are moved.

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
                sync(partial / file.name)
            files.rmdir()
        else:
            for name, content in files.items():
                _write(partial / name, content)
        sync(partial)
        remove_folder(path)
        partial.replace(path)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    sync(path.parent)


def remove_folder(path: Path) -> None:
    """Remove a folder and its content, if it exists.

    Raises:
        OSError: If it cannot be removed.
    """
    if path.exists():
        shutil.rmtree(path)


def remove_partial(folder: Path) -> None:
    """Remove incomplete files and folders; no process may be writing there.

    Raises:
        OSError: If one cannot be removed.
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


def sync(path: Path) -> None:
    """Force a file's content, or a folder's names, to the disk.

    Raises:
        OSError: If that fails.
    """
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
