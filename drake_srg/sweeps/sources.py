"""Which code and models a trial is made of, where the version is one of many commits.

A checkout has the same version from one release to the next.
"""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path

from drake_srg.parsing import models_path

_PACKAGE = Path(__file__).resolve().parents[1]

# What Python, scenarios and Drake's parser read; not what editors leave behind.
SUFFIXES = {".py", ".yaml", ".csv", ".xml", ".sdf", ".urdf", ".obj", ".vtk"}
SUFFIXES |= {".gltf", ".bin", ".stl", ".mtl", ".png"}

# They read what trials have left, or do without sweeps.
_NO_TRIAL = ("sweeps/report/", "sweeps/dataset/", "experiments/")


@functools.cache
def sources_hash() -> str:
    """Return a short hash of the package's own files that a trial depends on.

    It is the same for the same files in a checkout and in a wheel, on any machine, and
    is taken once a process.

    Raises:
        OSError: If a file cannot be read.
    """
    return hash_files(_PACKAGE, models_path())


def hash_files(package: Path, models: Path) -> str:
    """Return a short hash of the names and contents of a package's files.

    Args:
        package: Its folder.
        models: That of its models, which may be in it.
    """
    files = {path.relative_to(package).as_posix(): path for path in package.rglob("*")}
    files |= {
        f"models/{path.relative_to(models).as_posix()}": path
        for path in models.rglob("*")
    }
    whole = hashlib.sha256()
    for name, path in sorted(files.items()):
        if path.suffix in SUFFIXES and not name.startswith(_NO_TRIAL):
            content = hashlib.sha256(path.read_bytes()).hexdigest()
            whole.update(f"{content} {name}\n".encode())
    return whole.hexdigest()[:12]
