"""A cache of folders by key, in the user's cache directory."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from drake_srg.common.exceptions import ScenarioError

_MANIFEST = "files.json"  # SHA-256 of each file


def cache_folder() -> Path:
    """Return the folder for imported objects: below XDG_CACHE_HOME or ~/.cache."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "drake_srg" / "objects"


def cached_folder(key: str, make: Callable[[Path], None]) -> Path:
    """Return the folder of a key; make it if it is missing or damaged.

    It appears when it is complete, so several processes can share a cache.

    Args:
        key: Name of the folder.
        make: Fills an empty folder.

    Raises:
        ScenarioError: If the cache cannot be written.
    """
    folder = cache_folder() / key
    if _is_intact(folder):
        return folder
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".", dir=folder.parent) as there:
            new = Path(there) / key
            new.mkdir()
            make(new)
            digests = {path.name: _digest(path) for path in sorted(new.iterdir())}
            (new / _MANIFEST).write_text(json.dumps(digests), encoding="utf-8")
            if folder.exists():
                folder.rename(Path(there) / "damaged")
            try:
                new.rename(folder)
            except OSError:  # another process was faster; its folder is as good
                if not folder.is_dir():
                    raise
    except OSError as error:
        raise ScenarioError(
            f"{folder.parent}: cannot be written: {error.strerror} "
            "(set XDG_CACHE_HOME to another folder)"
        ) from None
    return folder


def copy_folder(folder: Path, to: Path) -> None:
    """Copy a folder of the cache, without what the cache added."""
    shutil.copytree(folder, to, ignore=shutil.ignore_patterns(_MANIFEST))


def _is_intact(folder: Path) -> bool:
    try:
        digests = json.loads((folder / _MANIFEST).read_text(encoding="utf-8"))
        return all(_digest(folder / name) == d for name, d in digests.items())
    except (OSError, ValueError, AttributeError):
        return False


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
