"""The committed results in docs/experiments, their stamps, and how new rows differ."""

from __future__ import annotations

import dataclasses as dc
import hashlib
import importlib.metadata
import io
import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from PIL import Image

from drake_srg.common.exceptions import ScenarioError
from drake_srg.sweeps.files import write_file
from experiments.runner.claims import Row
from experiments.runner.run import RESULT
from experiments.runner.sources import ROOT, code_of

COMMITTED = ROOT / "docs/experiments"
LARGEST = 100_000  # file size of a picture in docs [bytes]
_STAMP, _STAMPS = "stamp.json", "stamps.json"


@dc.dataclass(frozen=True)
class Stamp:
    """The conditions under which a result was made."""

    sources: str  # hash of what the experiment runs, see `sources`
    drake: str  # version of Drake
    result: str  # hash of result.json: a result of other parameters has no stamp
    seconds: float  # wall-clock time of the run [s]


def drake_version() -> str:
    """Return the version of Drake that runs."""
    return importlib.metadata.version("drake")


def show_time(seconds: float) -> str:
    """Return a duration for people, such as `8 s` or `12 min`."""
    return f"{seconds:.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.0f} min"


def make_stamp(folder: Path, seconds: float) -> Stamp:
    """Return the stamp of the new result in a folder NAME, made in `seconds` [s]."""
    result = hashlib.sha256((folder / RESULT).read_bytes()).hexdigest()[:12]
    return Stamp(code_of(folder.name), drake_version(), result, round(seconds, 1))


def write_stamp(folder: Path, stamp: Stamp) -> None:
    """Write the stamp of a folder's result."""
    write_file(folder / _STAMP, _dump(dc.asdict(stamp)))


def current_stamp(folder: Path) -> Stamp | None:
    """Return the stamp of a folder's result; None if it must be made again."""
    try:
        stamp = Stamp(**json.loads((folder / _STAMP).read_text(encoding="utf-8")))
        unchanged = make_stamp(folder, stamp.seconds) == stamp
    except (OSError, ValueError, TypeError):  # missing, cut off or of another form
        return None
    return stamp if unchanged and (folder / f"{folder.name}.png").is_file() else None


def _dump(value: object) -> bytes:
    return (json.dumps(value, indent=2) + "\n").encode()


def read_rows(result: Path) -> list[Row]:
    """Return the rows of a result.json.

    Raises:
        OSError: If it cannot be read.
        ScenarioError: If its content is not a result.
    """
    try:
        return [Row.from_dict(v) for v in json.loads(result.read_text("utf-8"))]
    except (ValueError, KeyError, TypeError) as error:
        raise ScenarioError(f"{result}: invalid content: {error!r}") from None


def committed_rows(name: str, folder: Path = COMMITTED) -> list[Row] | None:
    """Return the rows of an experiment; None if there is no committed result."""
    path = folder / f"{name}.json"
    return read_rows(path) if path.exists() else None


def read_stamps(folder: Path = COMMITTED) -> dict[str, Stamp]:
    """Return the stamps of committed results by experiment."""
    path = folder / _STAMPS
    if not path.exists():
        return {}
    try:
        read = json.loads(path.read_text(encoding="utf-8"))
        return {name: Stamp(**values) for name, values in read.items()}
    except (ValueError, TypeError, AttributeError) as error:
        raise ScenarioError(f"{path}: invalid content: {error!r}") from None


def accept(made: Mapping[str, Stamp], out: Path, folder: Path = COMMITTED) -> None:
    """Copy new results from their folders in `out` into the docs, with their stamps."""
    for name in made:
        with Image.open(out / name / f"{name}.png") as picture:
            write_file(folder / f"{name}.png", shrink(picture))
        write_file(folder / f"{name}.json", (out / name / RESULT).read_bytes())
    stamps = {**read_stamps(folder), **made}
    content = {name: dc.asdict(stamps[name]) for name in sorted(stamps)}
    write_file(folder / _STAMPS, _dump(content))


def shrink(picture: Image.Image) -> bytes:
    """Return a picture as PNG with as many colours as `LARGEST` allows."""
    for colors in (256, 128, 64, 32):
        file = io.BytesIO()
        few = picture.convert("RGB").quantize(colors, dither=Image.Dither.NONE)
        few.save(file, "PNG", optimize=True)
        if file.tell() < LARGEST:
            break
    return file.getvalue()


@dc.dataclass(frozen=True)
class Change:
    """A changed row that needs attention.

    A row that fails may have moved as well. The new value of a wall-clock row is as if
    measured at the speed of the machine that made the committed one.
    """

    what: Literal["failed", "moved", "appeared", "vanished"]
    row: Row  # the new one, or the old one if it has vanished
    old: float  # NaN if there is none
    new: float  # NaN if there is none


def compare(old: Sequence[Row] | None, new: Sequence[Row]) -> list[Change]:
    """Return the rows that moved by more than their spread, are new, gone or fail.

    A row with a known reason to miss its criterion does not fail, but may move. Rows
    are the same if they agree in name, quantity and unit; of several such rows, the
    first belongs to the first. The spread that counts is the committed one.
    """
    before, after = _keyed(old or ()), _keyed(new)
    slower = slowdown(old or (), new)
    changes = []
    for key in {**before, **after}:
        was, row = before.get(key), after.get(key)
        if row is None:
            assert was is not None
            changes.append(Change("vanished", was, was.measured, math.nan))
            continue
        value = row.measured
        if row.clock:
            value = value / slower if row.clock == "time" else value * slower
        committed = was.measured if was else math.nan
        if row.fails:
            changes.append(Change("failed", row, committed, value))
        elif was is None:
            if old is not None:
                changes.append(Change("appeared", row, committed, value))
        elif _moved(was, value):
            changes.append(Change("moved", was, committed, value))
    return changes


def _keyed(rows: Sequence[Row]) -> dict[tuple[str, str, str, int], Row]:
    """Return rows by name, quantity, unit and a count of equal ones before."""
    seen: Counter[tuple[str, str, str]] = Counter()
    found = {}
    for row in rows:
        key = (row.name, row.quantity, row.unit)
        found[(*key, seen[key])] = row
        seen[key] += 1
    return found


def _moved(old: Row, value: float) -> bool:
    """Return whether a row's new value differs by more than the old row's spread."""
    if not math.isfinite(old.measured):
        return math.isfinite(value)
    return not abs(value - old.measured) <= old.spread


def slowdown(old: Sequence[Row], new: Sequence[Row]) -> float:
    """Return the ratio of this run's duration to the committed run's.

    This is the median over the wall-clock rows; 1 if there are none.
    """
    before, after = _keyed(old), _keyed(new)
    ratios = [
        after[key].measured / row.measured
        if row.clock == "time"
        else row.measured / after[key].measured
        for key, row in before.items()
        if key in after
        and row.clock
        and row.clock == after[key].clock
        and row.measured > 0.0
        and after[key].measured > 0.0
    ]
    return float(np.median(ratios)) if ratios else 1.0
