"""Stamps: what a result was made with, and whether it is still current."""

from __future__ import annotations

import dataclasses as dc
import functools
import hashlib
import importlib.metadata
import json
from collections.abc import Mapping
from pathlib import Path

from drake_srg.common.exceptions import ScenarioError
from drake_srg.sweeps.files import write_file
from drake_srg.sweeps.info import hash_files

ROOT = Path(__file__).resolve().parents[2]
RESULT, STAMP = "result.json", "stamp.json"


@dc.dataclass(frozen=True)
class Stamp:
    """What a result was made with.

    Attributes:
        sources: Hash of the package, its models and tools/measure.
        drake: Version of Drake.
        result: Hash of result.json, so that a result of other parameters, which
            `drake-srg experiment --set` puts into the same folder, has no stamp.
        seconds: Wall-clock time of the run [s].
    """

    sources: str
    drake: str
    result: str
    seconds: float


@functools.cache
def code_hash() -> str:
    """Return a hash of all that an experiment may depend on, once per process."""
    folders = {f"{name}/": ROOT / name for name in ("drake_srg", "models")}
    return hash_files({**folders, "measure/": ROOT / "tools" / "measure"})


def drake_version() -> str:
    """Return the version of Drake that runs."""
    return importlib.metadata.version("drake")


def make_stamp(result: Path, seconds: float) -> Stamp:
    """Return the stamp of a result that has just been made.

    Args:
        result: Its result.json.
        seconds: Wall-clock time of the run [s].
    """
    return Stamp(code_hash(), drake_version(), hash_result(result), round(seconds, 1))


def hash_result(result: Path) -> str:
    """Return a short hash of a result.json.

    Raises:
        OSError: If it cannot be read.
    """
    return hashlib.sha256(result.read_bytes()).hexdigest()[:12]


def current_stamp(folder: Path) -> Stamp | None:
    """Return the stamp of a folder's result if that need not be made again, else None.

    Args:
        folder: Of the experiment's results.
    """
    try:
        stamp = Stamp(**json.loads((folder / STAMP).read_text(encoding="utf-8")))
        unchanged = make_stamp(folder / RESULT, stamp.seconds) == stamp
    except (OSError, ValueError, TypeError):  # missing, cut off or of another form
        return None
    return stamp if unchanged and (folder / f"{folder.name}.png").is_file() else None


def read_stamps(path: Path) -> dict[str, Stamp]:
    """Return stamps by experiment; none if there is no such file.

    Raises:
        ScenarioError: If the file does not hold stamps.
    """
    if not path.exists():
        return {}
    try:
        read = json.loads(path.read_text(encoding="utf-8"))
        return {name: Stamp(**values) for name, values in read.items()}
    except (ValueError, TypeError, AttributeError) as error:
        raise ScenarioError(f"{path}: invalid content: {error!r}") from None


def write_stamps(path: Path, stamps: Mapping[str, Stamp]) -> None:
    """Write stamps by experiment."""
    write_file(path, dump({name: dc.asdict(stamps[name]) for name in sorted(stamps)}))


def write_stamp(folder: Path, stamp: Stamp) -> None:
    """Write the stamp of a folder's result."""
    write_file(folder / STAMP, dump(dc.asdict(stamp)))


def dump(value: object) -> bytes:
    """Return a value as the content of a JSON file."""
    return (json.dumps(value, indent=2) + "\n").encode()
