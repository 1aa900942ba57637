"""What a sweep is: the contents of its sweep.json."""

from __future__ import annotations

import dataclasses as dc
import importlib.metadata
import json
import platform
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
from pydrake.common.yaml import yaml_dump, yaml_load

from drake_srg.common.exceptions import ScenarioError
from drake_srg.sweeps.files import write_file
from drake_srg.sweeps.sources import sources_hash

SCHEMA_VERSION = 1
FILE = "sweep.json"
# What a sweep may keep of its trials: nothing but their rows, or recordings, too.
RECORD = ("none", "failures", "all")
# Of `current_versions`, those whose difference makes other rows.
_DECISIVE = ("drake_srg", "drake_srg_sources", "drake")


@dc.dataclass(frozen=True)
class SweepInfo:
    """The contents of sweep.json."""

    scenario: str  # name or file, as the command got it
    seed: int  # of trial 0; trial k has `seed` + k
    trials: int
    record: str  # one of RECORD
    overrides: Sequence[str]  # KEY=VALUE each
    tree: str  # the scenario with its bases and overrides, nothing drawn; YAML
    versions: Mapping[str, str]
    engine: str = ""
    jobs: int | None = None  # trials at a time; None: the cluster's cores
    started: str = ""  # date and time, ISO 8601
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
        ScenarioError: If there is none, or it is not one of ours.
    """
    path = folder / FILE
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        if values["schema_version"] != SCHEMA_VERSION:
            raise ScenarioError(
                f"{path}: has the schema version {values['schema_version']}; "
                f"allowed: {SCHEMA_VERSION}"
            )
        return SweepInfo(**values)
    except FileNotFoundError:
        raise ScenarioError(f"{folder}: no sweep there ({FILE} is missing)") from None
    except OSError as error:
        raise ScenarioError(
            f"{path}: cannot be read: {error.strerror or error}"
        ) from None
    except (ValueError, KeyError, TypeError) as error:
        if isinstance(error, ScenarioError):
            raise
        raise ScenarioError(f"{path}: is not the {FILE} of a sweep") from None


def dump_tree(tree: Mapping[str, Any]) -> str:
    """Return a tree of `load_tree` as YAML; the same tree gives the same text."""
    text: str = yaml_dump(tree)
    return text


def current_versions() -> dict[str, str]:
    """Return the versions of what makes a trial what it is."""
    return {
        "drake_srg": importlib.metadata.version("drake_srg"),
        "drake_srg_sources": sources_hash(),
        "drake": importlib.metadata.version("drake"),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "numpy": importlib.metadata.version("numpy"),
        "opencv": str(cv2.__version__),  # several packages have it
        "processor": _processor(),  # BLAS has other kernels for others
    }


def _processor() -> str:
    """The processor's name; of Linux, as Python knows its kind alone."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2] for line in lines if line.startswith("model name"))
    return next(names, platform.machine()).strip()


def version_difference(
    there: Mapping[str, str], here: Mapping[str, str]
) -> tuple[str, str, str] | None:
    """Return what makes other rows: its name, and which it is there and here.

    Args:
        there: What `current_versions` returned elsewhere, or earlier.
        here: The same, here and now.

    Returns:
        The first of several; None: rows are the same.
    """
    for name in _DECISIVE:
        if there.get(name) != here.get(name):
            return name, _words(there.get(name)), _words(here.get(name))
    return None


def difference(old: SweepInfo, new: SweepInfo) -> str:
    """Return why `new` cannot go on with what `old` began, in words; empty: it can.

    The number of trials may grow; who runs them, and how many at a time, may change.
    """
    different = version_difference(old.versions, new.versions)
    if different:
        name, there, here = different
        return f"{name}: {there} there, {here} now"
    pairs = [("record", old.record, new.record), ("seed", old.seed, new.seed)]
    if old.tree != new.tree:
        was, now = (dict(_leaves(yaml_load(data=info.tree), "")) for info in (old, new))
        keys = (key for key in {**was, **now} if was.get(key) != now.get(key))
        pairs += [(key, was.get(key), now.get(key)) for key in keys]
    for name, before, after in pairs:
        if before != after:
            return f"{name}: {_words(before)} there, {_words(after)} now"
    if new.trials < old.trials:
        return f"trials: {old.trials} there, {new.trials} now"
    return ""


def _leaves(tree: Any, key: str) -> Iterator[tuple[str, Any]]:
    """Pairs of dotted key and value."""
    if not (isinstance(tree, dict | list) and tree):
        yield key, tree
        return
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for name, value in items:
        yield from _leaves(value, f"{key}.{name}" if key else str(name))


def _words(value: object) -> str:
    return "nothing" if value is None else str(value)
