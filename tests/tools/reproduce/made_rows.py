"""Rows, stamps and folders of results that no experiment made."""

import json
import os
import time
from pathlib import Path

from PIL import Image

from drake_srg.experiments.row import Row
from reproduce.stamps import Stamp, make_stamp, write_stamp

STAMP = Stamp("c0de", "1.2.3", "re5u17", 8.4)


def rows(value=1.0, wall=2.0):
    return [
        Row.at_most("can", "slip", 3.0, value, "mm"),
        Row.info("can", "duration", wall, "s", clock="time"),
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
    stamp = make_stamp(folder / "result.json", seconds)
    write_stamp(folder, stamp)
    return stamp


def work_for_hours(file: Path):
    """Write the process's number, then do nothing for long."""
    file.with_suffix(".part").write_text(str(os.getpid()))
    file.with_suffix(".part").rename(file)
    time.sleep(3600.0)
