"""Make the pictures of README.md and docs: docs/cells.webp and docs/varied.jpg.

Run `python tools/make_picture.py [RUN RUN]`. docs/cells.webp plays the videos of two
recorded runs, one per cell: those in the given folders, or else new ones.
"""

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import av
import numpy as np
from PIL import Image

from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.station import MakeStation

DOCS = Path(__file__).parents[1] / "docs"
CELLS = ("kitchen", "assistive_arm")
SIZE, RATE, PAUSE = (448, 252), 8, 1500  # pixels, frames per second, ms at the end
# More pixels than shown, against the traces of video compression.
SHARP = ("cameras.overview.width=1280", "cameras.overview.height=720")
VIEW, SEEDS = (320, 240), 4


def make_moving_picture(runs: Sequence[Path]) -> None:
    """Show the videos of recorded runs side by side, for as long as the longest."""
    videos = [_frames(run / "video.mp4") for run in runs]
    pictures = []
    for i in range(max(map(len, videos))):
        picture = Image.new("RGB", (len(videos) * SIZE[0], SIZE[1]))
        for column, frames in enumerate(videos):
            picture.paste(frames[min(i, len(frames) - 1)], (column * SIZE[0], 0))
        pictures.append(picture)
    pictures[0].save(
        DOCS / "cells.webp",
        save_all=True,
        append_images=pictures[1:],
        duration=[*[1000 // RATE] * (len(pictures) - 1), PAUSE],
        loop=0,
        quality=60,
        method=6,
    )


def _frames(video: Path) -> list[Image.Image]:
    """Return the frames of a video, `RATE` per second."""
    with av.open(str(video)) as container:
        frames = [frame.to_image() for frame in container.decode(video=0)]
        rate = float(container.streams.video[0].average_rate)
    rows = np.arange(0.0, len(frames), rate / RATE).astype(int)
    return [frames[row].resize(SIZE, Image.Resampling.LANCZOS) for row in rows]


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
        make_moving_picture([Path(folder) for folder in sys.argv[1:]])
    else:
        with tempfile.TemporaryDirectory() as folder:
            for cell in CELLS:
                scenario = load_scenario(cell, overrides=SHARP)
                Simulate(scenario, name=cell, out=Path(folder) / cell)
            make_moving_picture([Path(folder) / cell for cell in CELLS])
