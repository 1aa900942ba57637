"""Rows, stamps and folders of results that no experiment made."""

import json
from pathlib import Path

from PIL import Image

import experiments.runner as ex
from experiments.runner.claims import row
from experiments.runner.committed import Stamp, make_stamp, write_stamp

STAMP = Stamp("c0de", "1.2.3", "re5u17", 8.4)


def rows(value=1.0, wall=2.0):
    return [
        row("can", "slip", value, "mm", ex.at_most(3.0)),
        row("can", "duration", wall, "s", ex.number(clock="time")),
    ]


def write_result(folder: Path, made):
    """Write a result.json and a picture as an experiment does."""
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps([row.as_dict() for row in made])
    (folder / "result.json").write_text(text)
    Image.new("RGB", (20, 10), "navy").save(folder / f"{folder.name}.png")


def write_stamped(folder: Path, made, seconds=8.4):
    """Write a result with its stamp; returns the stamp."""
    write_result(folder, made)
    stamp = make_stamp(folder, seconds)
    write_stamp(folder, stamp)
    return stamp
