"""A hash of the code, scenarios and models that a trial depends on.

The package's version does not identify them: it changes with a release, not a commit.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping
from pathlib import Path

from drake_srg.parsing import models_path

_PACKAGE = Path(__file__).resolve().parents[1]

# The files that Python and Drake's parser read, not those that editors leave behind.
SUFFIXES = {".py", ".yaml", ".csv", ".xml", ".sdf", ".urdf", ".obj", ".vtk"}
SUFFIXES |= {".gltf", ".bin", ".stl", ".mtl", ".png"}

# Folders and modules that no trial imports: they build on trials, or have nothing to do
# with sweeps. Changing one of them does not make a sweep's rows incomparable.
NOT_IN_A_TRIAL = (
    "__main__.py",
    "bridges/",
    "cli/",
    "experiments/",
    "simulation/bench.py",
    "simulation/benchmark.py",
    "simulation/rig.py",
    "sweeps/dataset/",
    "sweeps/report/",
    "sweeps/statistics.py",
    "sweeps/summary.py",
)


@functools.cache
def sources_hash() -> str:
    """Return a short hash of the package's files that a trial depends on.

    The same files give the same hash in a checkout and in a wheel, on any machine. The
    hash is computed once per process.

    Raises:
        OSError: If a file cannot be read.
    """
    folders = {"": _PACKAGE, "models/": models_path()}
    return hash_files(folders, left_out=NOT_IN_A_TRIAL)


def hash_files(folders: Mapping[str, Path], left_out: tuple[str, ...] = ()) -> str:
    """Return a short hash of the names and contents of files of code and models.

    Args:
        folders: Where to look for files; each key is put before the names of its files.
            Of equal names, the later one counts.
        left_out: Starts of names that do not count.

    Raises:
        OSError: If a file cannot be read.
    """
    files = {
        prefix + path.relative_to(folder).as_posix(): path
        for prefix, folder in folders.items()
        for path in folder.rglob("*")
    }
    whole = hashlib.sha256()
    for name, path in sorted(files.items()):
        if path.suffix in SUFFIXES and not name.startswith(left_out):
            content = hashlib.sha256(path.read_bytes()).hexdigest()
            whole.update(f"{content} {name}\n".encode())
    return whole.hexdigest()[:12]
