"""The identity of a sweep: sweep.json, and a hash of the files that trials depend on.

The package's version is not enough, because a commit does not change it.
"""

from __future__ import annotations

import contextlib
import dataclasses as dc
import functools
import hashlib
import importlib.metadata
import json
import platform
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
from pydrake.common.yaml import yaml_dump, yaml_load

from drake_srg.common.exceptions import ScenarioError, checked_types
from drake_srg.common.tables import read_json
from drake_srg.objects.meshes.load import model_files, resolve
from drake_srg.parsing import models_path
from drake_srg.sweeps.files import write_file

_PACKAGE = Path(__file__).resolve().parents[1]

# Suffixes of files that Python and Drake's parser read; editors leave others behind.
SUFFIXES = {".py", ".pyi", ".yaml", ".csv", ".xml", ".sdf", ".urdf", ".obj", ".vtk"}
SUFFIXES |= {".gltf", ".bin", ".stl", ".mtl", ".png"}

# Folders and modules that no trial of `drake-srg sweep` imports. Changing one of them
# does not make a sweep's rows incomparable.
NOT_IN_A_TRIAL = (
    "__main__.py",
    "cli/",
    "learning/",
    "robot/",
    "simulation/benchmark.py",
    "sweeps/dataset/",
    "sweeps/report/",
    "sweeps/statistics.py",
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
        folders: Folders by the prefix of their files' names. If two names are equal,
            the later file counts.
        left_out: Prefixes of names that do not count.

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


SCHEMA_VERSION = 1
FILE = "sweep.json"
# Which trials keep a recording besides their row.
RECORD = ("none", "failures", "all")
# The entries of `current_versions` that can change rows.
_DECISIVE = ("drake_srg", "drake_srg_sources", "drake")


@dc.dataclass(frozen=True)
class SweepInfo:
    """The contents of sweep.json."""

    scenario: str  # name or path, as given to the command
    seed: int  # of trial 0; trial k has `seed` + k
    trials: int
    record: str  # one of RECORD
    overrides: Sequence[str]  # KEY=VALUE each
    tree: str  # YAML of the scenario with bases and overrides, before values are drawn
    versions: Mapping[str, str]
    engine: str = ""
    jobs: int | None = None  # trials at a time; None: one per core of the cluster
    started: str = ""  # date and time, ISO 8601
    policy: str = ""  # of `drake-srg evaluate`; a sweep has none
    cell: str = ""  # `module:function` that builds a cell of the user's own
    files: Mapping[str, str] = dc.field(default_factory=dict)  # see `hash_model_files`
    schema_version: int = SCHEMA_VERSION

    def write(self, folder: Path) -> None:
        """Write sweep.json.

        Raises:
            OSError: If it cannot be written.
        """
        text = json.dumps(dc.asdict(self), indent=2) + "\n"
        write_file(folder / FILE, text.encode())


def read_sweep(folder: Path) -> SweepInfo:
    """Read the sweep.json of a folder.

    Raises:
        ScenarioError: If the file is missing, or is not that of a sweep.
    """
    path = folder / FILE
    if not path.is_file():
        raise ScenarioError(f"{folder}: contains no sweep ({FILE} is missing)")

    def build(values: Any) -> SweepInfo:
        if values["schema_version"] != SCHEMA_VERSION:
            raise ScenarioError(
                f"{path}: schema_version: got {values['schema_version']} "
                f"(allowed: {SCHEMA_VERSION})"
            )
        return checked_types(SweepInfo(**values))

    return read_json(path, build)


def dump_tree(tree: Mapping[str, Any]) -> str:
    """Return a tree of `load_tree` as YAML; equal trees give equal text."""
    text: str = yaml_dump(tree)
    return text


def hash_model_files(tree: Mapping[str, Any]) -> dict[str, str]:
    """Return a short hash of each model of the user's own that a scenario names.

    Args:
        tree: Tree of the scenario, before values are drawn.

    Returns:
        The hashes by path or URL, as in the scenario. A model's hash includes the
        meshes, materials and textures that it names. The package's own models are left
        out.
    """
    hashes = {}
    for _, value in _leaves(tree, ""):
        if isinstance(value, str) and not value.startswith("package://drake_srg/"):
            whole = hashlib.sha256()
            with contextlib.suppress(ScenarioError, OSError, ValueError):
                path = resolve(value)
                if path.suffix.lower() in SUFFIXES and path.is_file():
                    for file in model_files(path):
                        whole.update(hashlib.sha256(file.read_bytes()).digest())
                    hashes[value] = whole.hexdigest()[:12]
    return hashes


def current_versions() -> dict[str, str]:
    """Return the versions of everything that a trial's outcome may depend on."""
    return {
        "drake_srg": importlib.metadata.version("drake_srg"),
        "drake_srg_sources": sources_hash(),
        "drake": importlib.metadata.version("drake"),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "numpy": importlib.metadata.version("numpy"),
        "opencv": str(cv2.__version__),  # several packages provide cv2
        "processor": _processor(),  # BLAS chooses its kernels by it
    }


def _processor() -> str:
    """Return the processor's name from Linux; Python knows only its architecture."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2] for line in lines if line.startswith("model name"))
    return next(names, platform.machine()).strip()


def version_difference(
    there: Mapping[str, str], here: Mapping[str, str]
) -> tuple[str, str, str] | None:
    """Return the first version that differs and can change rows.

    Args:
        there: Result of `current_versions` on another machine, or earlier.
        here: Result of `current_versions` here and now.

    Returns:
        Name, version there and version here; None if no such version differs.
    """
    for name in _DECISIVE:
        if there.get(name) != here.get(name):
            return name, _words(there.get(name)), _words(here.get(name))
    return None


def difference(old: SweepInfo, new: SweepInfo) -> str:
    """Return why `new` cannot continue `old`, in words; empty if it can.

    The number of trials may grow, and the engine and the number of jobs may change.
    """
    different = version_difference(old.versions, new.versions)
    if different:
        name, there, here = different
        return f"{name}: was {there}, is {here}"
    pairs = [
        (name, getattr(old, name), getattr(new, name))
        for name in ("record", "seed", "policy", "cell")
    ]
    if old.tree != new.tree:
        was, now = (dict(_leaves(yaml_load(data=info.tree), "")) for info in (old, new))
        keys = (key for key in {**was, **now} if was.get(key) != now.get(key))
        pairs += [(key, was.get(key), now.get(key)) for key in keys]
    pairs += [(name, old.files.get(name), now) for name, now in new.files.items()]
    for name, before, after in pairs:
        if before != after:
            return f"{name}: was {_words(before)}, is {_words(after)}"
    if new.trials < old.trials:
        return f"trials: was {old.trials}, is {new.trials}"
    return ""


def _leaves(tree: Any, key: str) -> Iterator[tuple[str, Any]]:
    """Yield the dotted key and the value of every leaf."""
    if not (isinstance(tree, dict | list) and tree):
        yield key, tree
        return
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for name, value in items:
        yield from _leaves(value, f"{key}.{name}" if key else str(name))


def _words(value: object) -> str:
    return "missing" if value is None else str(value)
