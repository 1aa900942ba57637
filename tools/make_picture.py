"""Makes docs/SCENARIO.jpg, pictures of README.md, from runs of the program.

Run as `python tools/make_picture.py SCENARIO`, or with the folder of a recorded run
after it.
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

DOCS = Path(__file__).parents[1] / "docs"
SHOWN = (Mode.CLOSE, Mode.TRANSFER, Mode.RELEASE)
SIZE = (640, 360)


def make_picture(scenario: str, run: Path) -> None:
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
    picture.save(DOCS / f"{scenario}.jpg", quality=88)


if __name__ == "__main__":
    scenario, *runs = sys.argv[1:]
    if runs:
        make_picture(scenario, Path(runs[0]))
    else:
        with tempfile.TemporaryDirectory() as folder:
            Simulate(load_scenario(scenario), name=scenario, out=Path(folder))
            make_picture(scenario, Path(folder))
