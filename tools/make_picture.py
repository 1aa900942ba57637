"""Makes docs/kitchen.jpg, the picture of README.md, from a run of the program.

Run as `python tools/make_picture.py`, or with the folder of a recorded run.
"""

import sys
import tempfile
from pathlib import Path

import av
import numpy as np
from PIL import Image

from drake_srg.recording.log import read_log
from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.types import Mode

PICTURE = Path(__file__).parents[1] / "docs" / "kitchen.jpg"
SHOWN = (Mode.CLOSE, Mode.TRANSFER, Mode.RELEASE)
SIZE = (640, 360)


def make_picture(run: Path) -> None:
    """Join frames from the end of the shown modes of a recorded run, left to right."""
    with av.open(str(run / "video.mp4")) as container:
        frames = [frame.to_image() for frame in container.decode(video=0)]
        rate = float(container.streams.video[0].average_rate)
    log = read_log(run / "log.npz")
    picture = Image.new("RGB", (len(SHOWN) * SIZE[0], SIZE[1]))
    for i, mode in enumerate(SHOWN):
        rows = np.flatnonzero(log["mode"] == list(Mode).index(mode))
        frame = frames[int(log["time"][rows[-1]] * rate) - 1]
        picture.paste(frame.resize(SIZE, Image.Resampling.LANCZOS), (i * SIZE[0], 0))
    picture.save(PICTURE, quality=88)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        make_picture(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as folder:
            Simulate(load_scenario("kitchen"), name="kitchen", out=Path(folder))
            make_picture(Path(folder))
