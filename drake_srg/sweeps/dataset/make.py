"""Makes a LeRobot data set of the recordings of a sweep.

Each trial is an episode, each image time a frame of it; see docs/dataset.md. The format
is `drake_srg.sweeps.dataset.format`'s.
"""

from __future__ import annotations

import dataclasses as dc
import json
import os
import tempfile
from fractions import Fraction
from pathlib import Path
from typing import Any

from tqdm import tqdm

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.scenario.yaml_tree import parse_yaml
from drake_srg.sweeps.dataset.recording import Layout, read_images, read_signals
from drake_srg.sweeps.dataset.writer import DatasetWriter
from drake_srg.sweeps.info import read_sweep
from drake_srg.sweeps.rows import read_rows

_RECORDING, _METRICS = "recording.mcap", "metrics.json"


@dc.dataclass(frozen=True)
class Dataset:
    """What was made: numbers of episodes, of those successful, and of frames."""

    path: Path
    episodes: int
    successes: int
    frames: int
    fps: int
    left_out: str = ""  # recordings that are no episodes: how many and why, in words


def make_dataset(
    sweep: Path,
    out: Path | None = None,
    *,
    fps: int | None = None,
    only_success: bool = False,
    progress: bool = False,
) -> Dataset:
    """Make a LeRobot data set of the trials of a sweep that were recorded.

    It appears under its name when it is complete; what is interrupted leaves nothing.
    Of a sweep that runs, it has the trials that are over when this begins.

    Args:
        sweep: Folder of a sweep made with `--record all` (or failures).
        out: Folder to make; default: `dataset` in that of the sweep.
        fps: Frames per second; None: all images. A divisor of the images' rate.
        only_success: Whether to leave out trials that failed.
        progress: Whether to show a progress bar.

    Raises:
        ImportError: If rosbags or PyAV is missing.
        OSError: If `out` cannot be written.
        ScenarioError: If there are no recordings of trials that came to their end, or
            not all alike; if the sweep's rows cannot be read; if `fps` does not fit; or
            if `out` exists.
    """
    out = sweep / "dataset" if out is None else out
    if out.exists():
        raise ScenarioError(f"-o {out}: exists; choose another folder, or remove it")
    task, robot = _task_and_robot(sweep)
    trials, left_out = _recorded_trials(sweep, only_success)
    layout = read_signals(trials[0] / _RECORDING).layout
    fps = _whole_rate(layout.rate) if fps is None else fps
    every = _stride(layout.rate, fps)
    out.parent.mkdir(parents=True, exist_ok=True)
    successes = 0
    with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as folder:
        root = Path(folder) / out.name
        with DatasetWriter(root, layout, fps, task=task, robot=robot) as writer:
            for trial in tqdm(trials, unit="episode", disable=not progress):
                successes += _add_trial(writer, trial, layout, every)
            writer.finish()
        _sync(root)
        root.rename(out)
    return Dataset(out, len(trials), successes, writer.frames, fps, left_out)


def _add_trial(writer: DatasetWriter, trial: Path, layout: Layout, every: int) -> bool:
    """Add a trial as an episode, one of so many images a frame; was it a success?"""
    signals = read_signals(trial / _RECORDING)
    if signals.layout != layout:
        raise ScenarioError(
            f"{trial} has {signals.layout}, the trials before it have {layout}; "
            "those of a data set must be recorded alike"
        )
    metrics = _metrics(trial)
    writer.add(
        dc.replace(
            signals, state=signals.state[::every], action=signals.action[::every]
        ),
        {
            camera: read_images(trial / _RECORDING, camera, every)
            for camera in layout.cameras
        },
        about={"trial": int(trial.name), **metrics},
    )
    return bool(metrics["success"])


def _task_and_robot(sweep: Path) -> tuple[str, str]:
    """What was done, in words, and the scenario's name."""
    info = read_sweep(sweep)
    pick = parse_yaml(info.tree, str(sweep))["task"]["pick"].replace("_", " ")
    return f"Pick up the {pick} and place it on its goal.", Path(info.scenario).stem


def _recorded_trials(sweep: Path, only_success: bool) -> tuple[list[Path], str]:
    """Folders of the trials' recordings, in order, and what is left out, in words.

    A trial's recording is there before its row and does not change from then on, so
    that the sweep may go on meanwhile.
    """
    over = set(read_rows(sweep)["trial"].to_pylist())
    folders = sorted((sweep / "recordings").glob("[0-9]*[0-9]"))
    folders = [folder for folder in folders if folder.name.isdecimal()]  # no copies
    rowed = [folder for folder in folders if int(folder.name) in over]
    trials = [  # metrics.json is written last, and not where there is an error
        folder
        for folder in rowed
        if (folder / _RECORDING).exists() and (folder / _METRICS).exists()
    ]
    counts = {
        "that ended in an error": len(rowed) - len(trials),
        "not over": len(folders) - len(rowed),
    }
    left_out = ", ".join(f"{n} {what}" for what, n in counts.items() if n)
    if not trials:
        raise ScenarioError(
            f"{sweep}: has no recordings of trials to their end ({left_out})"
            if left_out
            else f"{sweep}: has no recordings; make the sweep with --record all"
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
        raise ScenarioError(f"{path}: is not a trial's: {one_line(error)}") from error


def _sync(root: Path) -> None:
    """Have all files of a folder on the disk, should power fail."""
    for path in (*root.rglob("*"), root):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _whole_rate(rate: Fraction) -> int:
    if rate.denominator != 1:
        raise ScenarioError(
            f"images come at {float(rate):g} Hz, and a data set has a whole number of "
            f"frames per second; {_allowed(rate)}"
        )
    return rate.numerator


def _stride(rate: Fraction, fps: int) -> int:
    """Every how many images there is a frame."""
    if fps < 1 or (rate / fps).denominator != 1:
        raise ScenarioError(
            f"--fps {fps}: images come at {float(rate):g} Hz; {_allowed(rate)}"
        )
    return (rate / fps).numerator


def _allowed(rate: Fraction) -> str:
    fitting = [f for f in range(1, int(rate) + 1) if (rate / f).denominator == 1]
    if fitting:
        return f"allowed for --fps: {', '.join(map(str, fitting))}"
    return "record with a recording.bag_camera_period of 1, 1/2, 1/3 ... s"
