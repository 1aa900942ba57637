"""Makes docs/cells.jpg, the picture of README.md, from a run of each of the two cells.

Run as `python tools/make_picture.py`, or with the folders of the recorded runs.
"""

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import av
import numpy as np
from PIL import Image

from drake_srg.recording.log import read_log
from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.types import Mode

PICTURE = Path(__file__).parents[1] / "docs" / "cells.jpg"
CELLS = ("kitchen", "assistive_arm")
SHOWN = (Mode.CLOSE, Mode.RELEASE)
SIZE = (640, 360)


def make_picture(runs: Sequence[Path]) -> None:
    """Join frames from the end of the shown modes, a column a recorded run."""
    picture = Image.new("RGB", (len(runs) * SIZE[0], len(SHOWN) * SIZE[1]))
    for column, run in enumerate(runs):
        with av.open(str(run / "video.mp4")) as container:
            frames = [frame.to_image() for frame in container.decode(video=0)]
            rate = float(container.streams.video[0].average_rate)
        log = read_log(run / "log.npz")
        for row, mode in enumerate(SHOWN):
            rows = np.flatnonzero(log["mode"] == list(Mode).index(mode))
            frame = frames[int(log["time"][rows[-1]] * rate) - 1]
            frame = frame.resize(SIZE, Image.Resampling.LANCZOS)
            picture.paste(frame, (column * SIZE[0], row * SIZE[1]))
    picture.save(PICTURE, quality=88)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        make_picture([Path(folder) for folder in sys.argv[1:]])
    else:
        with tempfile.TemporaryDirectory() as folder:
            for cell in CELLS:
                Simulate(load_scenario(cell), name=cell, out=Path(folder) / cell)
            make_picture([Path(folder) / cell for cell in CELLS])
