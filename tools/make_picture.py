"""Make the pictures of README.md: docs/cells.jpg and docs/varied.jpg.

Run `python tools/make_picture.py [RUN RUN]`. docs/cells.jpg shows frames from the
videos of two recorded runs, one per cell: those in the given folders, or else new ones.
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
from drake_srg.station import MakeStation
from drake_srg.types import Mode

DOCS = Path(__file__).parents[1] / "docs"
CELLS = ("kitchen", "assistive_arm")
SHOWN = (Mode.CLOSE, Mode.RELEASE)
SIZE = (640, 360)
# Twice as many pixels as shown, against the traces of video compression.
SHARP = ("cameras.overview.width=1280", "cameras.overview.height=720")
VIEW, SEEDS = (320, 240), 4


def make_picture(runs: Sequence[Path]) -> None:
    """Join the frames at the end of the shown modes, one column per recorded run."""
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
    picture.save(DOCS / "cells.jpg", quality=88)


def make_varied_picture() -> None:
    """Join the ceiling cameras' first images, one row per cell, one column per seed."""
    picture = Image.new("RGB", (SEEDS * VIEW[0], len(CELLS) * VIEW[1]))
    for row, cell in enumerate(CELLS):
        for seed in range(SEEDS):
            station = MakeStation(load_scenario(f"{cell}_varied_accurate", seed=seed))
            port = station.GetOutputPort("camera_ceiling.color_image")
            image = port.Eval(station.CreateDefaultContext()).data[..., :3]
            view = Image.fromarray(image).resize(VIEW, Image.Resampling.LANCZOS)
            picture.paste(view, (seed * VIEW[0], row * VIEW[1]))
    picture.save(DOCS / "varied.jpg", quality=88)


if __name__ == "__main__":
    make_varied_picture()
    if len(sys.argv) > 1:
        make_picture([Path(folder) for folder in sys.argv[1:]])
    else:
        with tempfile.TemporaryDirectory() as folder:
            for cell in CELLS:
                scenario = load_scenario(cell, overrides=SHARP)
                Simulate(scenario, name=cell, out=Path(folder) / cell)
            make_picture([Path(folder) / cell for cell in CELLS])
