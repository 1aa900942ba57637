"""Make the pictures of README.md and docs that show cells.

Run `python tools/make_picture.py [NAME]...`; without a name, it makes all pictures:
cells (docs/cells.webp), varied (docs/varied.jpg), insertion (docs/insertion.webp),
carrying (docs/carrying.webp), clearing_together (docs/clearing_together.webp), lessons
(docs/tutorial/*.webp).
"""

import argparse
import contextlib
import re
import shlex
import tempfile
from collections.abc import Sequence
from pathlib import Path

import av
import gymnasium
import numpy as np
from PIL import Image

from drake_srg.cli.main import main as drake_srg_main
from drake_srg.common.log_format import logged_modes
from drake_srg.learning.rules import grasp_one_shot
from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.station import MakeStation
from drake_srg.types import Mode

DOCS = Path(__file__).parents[1] / "docs"
CELLS = ("kitchen", "assistive_arm")
SIZE, RATE, PAUSE = (448, 252), 8, 1500  # pixels, frames per second, ms at the end
# Near the hole, in the direction in which the kitchen's camera looks; no caption.
INSERTION = (
    "cameras.overview.X_PB.translation=[0.80, -0.494, 0.22]",
    "recording.video_fps=4",
    "recording.inset_camera=''",
    "recording.bag_cameras=[]",
)
VIEW, SEEDS = (320, 240), 4
# What a lesson shows of a run: the moments at which these modes begin.
MOMENTS = (Mode.CLOSE, Mode.LIFT, Mode.TRANSFER, Mode.RELEASE)
SMALL = (400, 225)


def make_moving_picture() -> None:
    """Show the videos of both cells side by side, for as long as the longest."""
    videos = []
    for cell in CELLS:
        frames, rate, _ = _video(cell)
        rows = np.arange(0.0, len(frames), rate / RATE).astype(int)
        videos.append([_scaled(frames[row], SIZE) for row in rows])
    pictures = [
        _joined([frames[min(i, len(frames) - 1)] for frames in videos], len(CELLS))
        for i in range(max(map(len, videos)))
    ]
    pictures[0].save(
        DOCS / "cells.webp",
        save_all=True,
        append_images=pictures[1:],
        duration=[*[1000 // RATE] * (len(pictures) - 1), PAUSE],
        loop=0,
        quality=60,
        method=6,
    )


def make_varied_picture() -> None:
    """Join the ceiling cameras' first images, one row per cell, one column per seed."""
    views = [
        _ceiling(f"{cell}_varied_accurate", seed)
        for cell in CELLS
        for seed in range(SEEDS)
    ]
    _joined(views, SEEDS).save(DOCS / "varied.jpg", quality=88)


def make_insertion_picture() -> None:
    """Show the peg at the rim, at the wall and in the hole."""
    frames, rate, began = _video("insert", INSERTION)
    moments = (began["slide"], began["upright"], began["release"])
    views = [frames[round(rate * moment)] for moment in moments]
    side = views[0].height * 9 // 10  # above the bar of the caption
    left = (views[0].width - side) // 2
    squares = [view.crop((left, 0, left + side, side)) for view in views]
    picture = _joined([_scaled(square, (300, 300)) for square in squares], 3)
    picture.save(DOCS / "insertion.webp", quality=75, method=6)


def make_carrying_picture() -> None:
    """Show the crate in both hands, on its way, and on its mark."""
    frames, rate, began = _video("carry_together", ["recording.bag_cameras=[]"])
    moments = (began["settle"], 0.5 * (began["transfer"] + began["place"]))
    _save_row("carrying", frames, [round(rate * moment) for moment in moments])


def make_clearing_together_picture() -> None:
    """Show two arms at their first grasps, over their bins, and at home."""
    overrides = (
        "clutter.count=4",
        "recording.video_fps=4",
        "recording.bag_cameras=[]",
    )
    frames, rate, began = _video("clear_table_together", overrides)
    moments = (began["close"], began["release"])
    _save_row("clearing_together", frames, [round(rate * moment) for moment in moments])


def _save_row(name: str, frames: Sequence[Image.Image], rows: Sequence[int]) -> None:
    """Save some frames of a video and its last one side by side."""
    picture = _joined([_scaled(frames[row], SMALL) for row in (*rows, -1)], 3)
    picture.save(DOCS / f"{name}.webp", quality=75, method=6)


def make_lesson_pictures() -> None:
    """Make the picture of each lesson from the lesson's own runs."""
    kitchen = _moments("kitchen")
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        _save_files("your_object", "your_cell")
        exec(Path("mallet.py").read_text("utf-8"), {})
        command = "import mallet.stl --scale 0.001 --mass 0.3 -o mallet"
        drake_srg_main(shlex.split(command))
        mallet, corner = _moments("mallet.yaml"), _moments("corner.yaml")
    pictures = {
        "first_run": _joined(kitchen, 2),
        "your_object": _joined(mallet, 2),
        "your_localizer": _ceiling("kitchen", 0),
        "your_cell": _joined(corner, 2),
        "a_sweep": _joined([_ceiling("kitchen_varied", seed) for seed in range(4)], 2),
        "a_policy": _joined(_grasps(), 2),
    }
    for name, picture in pictures.items():
        picture.save(DOCS / f"tutorial/{name}.webp", quality=75, method=6)


def _save_files(*lessons: str) -> None:
    """Save the files that lessons show into the working directory."""
    for lesson in lessons:
        page = (DOCS / f"tutorial/{lesson}.md").read_text("utf-8")
        pattern = (
            r"as\s+`([\w.]+)`[^`]*?(?:`[^`]+`[^`]*?)*?```(?:python|yaml)\n(.*?)```"
        )
        for name, text in re.findall(pattern, page, re.DOTALL):
            Path(name).write_text(text, "utf-8")


def _video(
    scenario: str, overrides: Sequence[str] = ()
) -> tuple[list[Image.Image], float, dict[str, float]]:
    """Return the frames of a new run, their rate, and when each mode began [s]."""
    with tempfile.TemporaryDirectory() as folder:
        loaded = load_scenario(scenario, overrides=overrides)
        log = Simulate(loaded, name="run", out=Path(folder)).log
        with av.open(str(Path(folder) / "video.mp4")) as container:
            frames = [frame.to_image() for frame in container.decode(video=0)]
            rate = float(container.streams.video[0].average_rate)
    modes, first = np.unique(logged_modes(log), return_index=True)
    began = dict(zip(modes.tolist(), log["time"][first].tolist(), strict=True))
    return frames, rate, began


def _moments(scenario: str) -> list[Image.Image]:
    """Return the frames of the video in which the modes of `MOMENTS` begin."""
    frames, rate, began = _video(scenario)
    last = len(frames) - 1
    rows = [min(round(rate * began[mode.value]), last) for mode in MOMENTS]
    return [_scaled(frames[row], SMALL) for row in rows]


def _ceiling(scenario: str, seed: int) -> Image.Image:
    """Return the first image of the ceiling camera."""
    station = MakeStation(load_scenario(scenario, seed=seed))
    port = station.GetOutputPort("camera_ceiling.color_image")
    image = port.Eval(station.CreateDefaultContext()).data[..., :3]
    return _scaled(Image.fromarray(image), VIEW)


def _grasps() -> list[Image.Image]:
    """Return four objects in the hand, after the shake."""
    name = "drake_srg/GraspOneShot-v0"
    env = gymnasium.make(name, physics="train", driver="plant", render_mode="rgb_array")
    images = []
    for seed in range(4):
        observation, _ = env.reset(seed=seed)
        env.step(grasp_one_shot(observation))
        images.append(_scaled(Image.fromarray(env.render()), SMALL))
    return images


def _scaled(image: Image.Image, size: tuple[int, int]) -> Image.Image:
    return image.resize(size, Image.Resampling.LANCZOS)


def _joined(images: Sequence[Image.Image], columns: int) -> Image.Image:
    """Join images of one size, row by row."""
    width, height = images[0].size
    rows = -(-len(images) // columns)
    picture = Image.new("RGB", (columns * width, rows * height))
    for i, image in enumerate(images):
        picture.paste(image, (i % columns * width, i // columns * height))
    return picture


MAKERS = {
    "cells": make_moving_picture,
    "varied": make_varied_picture,
    "insertion": make_insertion_picture,
    "carrying": make_carrying_picture,
    "clearing_together": make_clearing_together_picture,
    "lessons": make_lesson_pictures,
}


def maker(name: str) -> str:
    """Return the name of a picture.

    Raises:
        argparse.ArgumentTypeError: If there is no such picture.
    """
    if name not in MAKERS:
        allowed = ", ".join(MAKERS)
        raise argparse.ArgumentTypeError(f"unknown {name!r} (allowed: {allowed})")
    return name


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", type=maker)
    for chosen in parser.parse_args().names or MAKERS:
        MAKERS[chosen]()
