"""Makes a LeRobot data set from the recordings of a sweep.

Each trial becomes an episode, and each image time a frame; see docs/dataset.md and, for
the format, `drake_srg.sweeps.dataset.format`.
"""

from __future__ import annotations

import dataclasses as dc
import json
import tempfile
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.common.status_line import StatusLine
from drake_srg.objects.models import known_shape
from drake_srg.scenario import draw_scenario
from drake_srg.scenario.yaml_tree import parse_yaml
from drake_srg.sweeps.dataset.recording import Layout, read_images, read_signals
from drake_srg.sweeps.dataset.writer import DatasetWriter
from drake_srg.sweeps.files import sync
from drake_srg.sweeps.info import SweepInfo, read_sweep
from drake_srg.sweeps.rows import read_rows
from drake_srg.types import Cylinder

_RECORDING, _METRICS = "recording.mcap", "metrics.json"


@dc.dataclass(frozen=True)
class Dataset:
    """A data set that has been made.

    Attributes:
        path: Its folder.
        episodes: Number of episodes.
        successes: Number of successful episodes.
        frames: Number of frames.
        fps: Frames per second.
        left_out: How many recordings are no episodes and why, in words.
    """

    path: Path
    episodes: int
    successes: int
    frames: int
    fps: int
    left_out: str = ""


def make_dataset(
    sweep: Path,
    out: Path | None = None,
    *,
    fps: int | None = None,
    only_success: bool = False,
    progress: bool = False,
) -> Dataset:
    """Make a LeRobot data set from the recorded trials of a sweep.

    The folder appears under its name when it is complete; an interruption leaves
    nothing. The sweep may still be running: trials that have finished are included.

    Args:
        sweep: Folder of a sweep that ran with `--record all` or `failures`.
        out: Folder to create; None: `dataset` in the sweep's folder.
        fps: Frames per second, a divisor of the image rate; None: every image.
        only_success: Whether to leave out trials that failed.
        progress: Whether to show progress on standard error.

    Raises:
        ImportError: If rosbags or PyAV is missing.
        OSError: If `out` cannot be written.
        ScenarioError: If there are no recordings of finished trials, recordings differ
            in their layout, rows cannot be read, `fps` does not fit, or `out` exists.
    """
    out = sweep / "dataset" if out is None else out
    if out.exists():
        raise ScenarioError(f"-o {out}: already exists; remove it or choose another")
    info = read_sweep(sweep)
    task, robot = _task_and_robot(info, sweep)
    trials, left_out = _recorded_trials(sweep, only_success)
    layout = read_signals(trials[0] / _RECORDING).layout
    fps = _whole_rate(layout.rate) if fps is None else fps
    every = _stride(layout.rate, fps)
    out.parent.mkdir(parents=True, exist_ok=True)
    successes = 0
    with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as folder:
        root = Path(folder) / out.name
        with DatasetWriter(root, layout, fps, task=task, robot=robot) as writer:
            with StatusLine(shown=progress) as line:
                for number, trial in enumerate(trials, 1):
                    about = {**_metrics(trial), **_known_object(info, int(trial.name))}
                    successes += about["success"]
                    _add_trial(writer, trial, layout, every, about)
                    line.count(number, len(trials), "episodes")
            writer.finish()
        for path in (*root.rglob("*"), root):  # in case power fails
            sync(path)
        root.rename(out)
    return Dataset(out, len(trials), successes, writer.frames, fps, left_out)


def _add_trial(
    writer: DatasetWriter,
    trial: Path,
    layout: Layout,
    every: int,
    about: Mapping[str, Any],
) -> None:
    """Add a trial as an episode.

    Args:
        writer: Receives the episode.
        trial: Folder of the recording.
        layout: Layout of the data set.
        every: Number of images per frame.
        about: Values of `format.TRIAL`, except the trial's number.
    """
    signals = read_signals(trial / _RECORDING)
    if signals.layout != layout:
        raise ScenarioError(
            f"{trial}: all recordings of a data set must have the same layout: got "
            f"{signals.layout}, expected {layout}"
        )
    writer.add(
        signals.every(every),
        {
            camera: read_images(trial / _RECORDING, camera, every)
            for camera in layout.cameras
        },
        about={"trial": int(trial.name), **about},
    )


def _known_object(info: SweepInfo, trial: int) -> dict[str, Any]:
    """Return what the robot knows of a trial's picked object, as in `format.TRIAL`."""
    unknown = {"object_size": None, "object_round": None}
    tree = parse_yaml(info.tree, info.scenario)
    if not (tree.get("objects") or tree.get("clutter")):
        return unknown
    scenario = draw_scenario(tree, info.scenario, info.seed + trial).scenario
    config = scenario.objects.get(scenario.task.pick)
    shape = None if config is None else known_shape(scenario.task.pick, config)
    if shape is None:
        return unknown
    return {
        "object_size": [float(x) for x in shape.bounding_size],
        "object_round": isinstance(shape, Cylinder),
    }


def _task_and_robot(info: SweepInfo, sweep: Path) -> tuple[str, str]:
    """Return the task in words and the scenario's name."""
    name = Path(info.scenario).stem
    task = parse_yaml(info.tree, str(sweep)).get("task") or {}
    if not task.get("pick"):
        return f"Follow the script of {name}.", name
    pick = task["pick"].replace("_", " ")
    return f"Pick up the {pick} and place it on its goal.", name


def _recorded_trials(sweep: Path, only_success: bool) -> tuple[list[Path], str]:
    """Return the folders of recordings in order, and in words what is left out.

    The sweep may still be running: a trial's recording is complete before its row is
    written.
    """
    over = set(read_rows(sweep)["trial"].to_pylist())
    folders = sorted((sweep / "recordings").glob("[0-9]*[0-9]"))
    folders = [folder for folder in folders if folder.name.isdecimal()]  # not copies
    rowed = [folder for folder in folders if int(folder.name) in over]
    trials = [  # metrics.json is written last, and not after an error
        folder
        for folder in rowed
        if (folder / _RECORDING).exists() and (folder / _METRICS).exists()
    ]
    counts = {
        "that ended in an error": len(rowed) - len(trials),
        "unfinished": len(folders) - len(rowed),
    }
    left_out = ", ".join(f"{n} {what}" for what, n in counts.items() if n)
    if not trials:
        raise ScenarioError(
            f"{sweep}: contains no recordings of finished trials ({left_out})"
            if left_out
            else f"{sweep}: contains no recordings; sweep with --record all"
        )
    if only_success:
        trials = [folder for folder in trials if _metrics(folder)["success"]]
        if not trials:
            raise ScenarioError(f"{sweep}: --only-success: no recorded trial succeeded")
    return trials, left_out


def _metrics(trial: Path) -> dict[str, Any]:
    path = trial / _METRICS
    try:
        metrics = json.loads(path.read_text(encoding="utf-8"))
        return {key: metrics[key] for key in ("seed", "success", "failure")}
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise ScenarioError(f"{path}: invalid content: {one_line(error)}") from error


def _whole_rate(rate: Fraction) -> int:
    if rate.denominator != 1:
        raise ScenarioError(
            f"images are recorded at {float(rate):g} Hz, but a data set needs a whole "
            f"number of frames per second; {_allowed(rate)}"
        )
    return rate.numerator


def _stride(rate: Fraction, fps: int) -> int:
    """Return the number of images per frame."""
    if fps < 1 or (rate / fps).denominator != 1:
        raise ScenarioError(
            f"--fps {fps}: must divide the image rate, {float(rate):g} Hz; "
            f"{_allowed(rate)}"
        )
    return (rate / fps).numerator


def _allowed(rate: Fraction) -> str:
    fitting = [f for f in range(1, int(rate) + 1) if (rate / f).denominator == 1]
    if fitting:
        return f"allowed for --fps: {', '.join(map(str, fitting))}"
    return "record with a recording.bag_camera_period of 1, 1/2, 1/3 ... s"
