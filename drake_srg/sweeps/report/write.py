"""The report of a sweep: one self-contained HTML page."""

from __future__ import annotations

import base64
import dataclasses as dc
import datetime
import functools
import importlib.resources
import os
import urllib.parse
from pathlib import Path

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.recording.output import OutputFile
from drake_srg.sweeps.info import SweepInfo, read_sweep
from drake_srg.sweeps.report import page
from drake_srg.sweeps.report.plots import number
from drake_srg.sweeps.report.trials import FALSE_DISCOVERIES, Trials, command
from drake_srg.sweeps.rows import read_rows, require_sweep, sampled_columns

_VIDEOS = 8
VIDEO_BYTES = 24_000_000  # of all videos, so that the page can be sent by mail


def write_report(folder: Path | str, output: Path | str | None = None) -> Path:
    """Write the report of a sweep, finished or not; returns its path.

    Args:
        folder: Folder of the sweep.
        output: The .html file; None: report.html in `folder`.

    Raises:
        ScenarioError: If there is no sweep, no trial has finished, or a row or a video
            cannot be read.
        OSError: If the page cannot be written.
        ImportError: If a package is missing.
    """
    folder = Path(folder)
    sweep = read_sweep(folder)
    table = read_rows(folder)
    if not table.num_rows:
        raise ScenarioError(f"{folder}: no trial has finished yet")
    path = folder / "report.html" if output is None else Path(output)
    html = _html(sweep, Trials(table, sampled_columns(table)), folder, path)
    file = OutputFile(path)
    # The page shows file names, which need not be UTF-8.
    file.path.write_text(html, encoding="utf-8", errors="replace")
    return file.commit()


def _html(sweep: SweepInfo, trials: Trials, folder: Path, path: Path) -> str:
    jinja2 = require_sweep("jinja2")
    environment = jinja2.Environment(
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters |= {
        "number": number,
        "p_value": page.p_value,
        "least": np.nanmin,
        "most": np.nanmax,
    }
    files = importlib.resources.files(__package__)
    videos, left_out = _videos(trials, folder)
    html: str = environment.from_string(
        files.joinpath("report.html").read_text(encoding="utf-8")
    ).render(
        sweep=sweep,
        trials=trials,
        style=files.joinpath("report.css").read_text(encoding="utf-8"),
        started=_date(sweep),
        command=_command(sweep),
        rerun=functools.partial(_rerun, sweep),
        tiles=page.summary(trials),
        **page.failures(trials),
        effects=page.effects(trials),
        false_discoveries=FALSE_DISCOVERIES,
        distributions=page.distributions(trials),
        worst=trials.worst(),
        replays=find_replays(trials, folder, path),
        videos=videos,
        left_out=left_out,
        totals=page.totals(trials, sweep.jobs),
    )
    return html


def find_replays(trials: Trials, folder: Path, page: Path) -> dict[int, str]:
    """Return links to the replays of recorded trials by row, the worst first.

    The links are relative to `page`.
    """
    paths = {
        row: folder / f"recordings/{trials.trial[row]:06d}/replay.html"
        for row in trials.worst()
    }
    return {
        row: urllib.parse.quote(os.path.relpath(path, page.parent))
        for row, path in paths.items()
        if path.is_file()
    }


@dc.dataclass(frozen=True)
class Video:
    """The video of a trial, with a description."""

    row: int
    source: str  # URL with the data
    name: str
    words: str


def _videos(trials: Trials, folder: Path) -> tuple[list[Video], list[str]]:
    """Return the videos of the worst trials, and the paths of those left out.

    Raises:
        ScenarioError: If a video cannot be read.
    """
    shown: list[Video] = []
    left_out: list[str] = []
    room = VIDEO_BYTES
    for row in trials.worst():
        name = f"recordings/{trials.trial[row]:06d}/video.mp4"
        path = folder / name
        if not path.is_file():
            continue
        size = path.stat().st_size
        if len(shown) < _VIDEOS and size <= room:
            shown.append(_video(trials, row, path))
            room -= size
        else:
            left_out.append(name)
    return shown, left_out


def _video(trials: Trials, row: int, path: Path) -> Video:
    try:
        data = base64.b64encode(path.read_bytes()).decode()
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from error
    what = "success" if trials.success[row] else trials.failure[row]
    if trials.claimed[row]:
        what += ", although the planner reported done"
    if trials.message[row]:
        what += f": {trials.message[row]}"
    away = trials.placement_error[row]
    if np.isfinite(away):
        what += f"; {number(1e3 * away, 'mm')} from the goal"
    name = f"Trial {trials.trial[row]}, seed {trials.seed[row]}"
    return Video(row, f"data:video/mp4;base64,{data}", name, what)


def _command(sweep: SweepInfo) -> str:
    """Return the command that repeats the sweep."""
    words = ("evaluate", sweep.policy) if sweep.policy else ("sweep",)
    return command(
        *(*words, sweep.scenario, "--trials", str(sweep.trials)),
        *("--seed", str(sweep.seed)),
        *(("--cell", sweep.cell) if sweep.cell else ()),
        overrides=sweep.overrides,
    )


def _rerun(sweep: SweepInfo, seed: int) -> str:
    """Return the command that repeats the trial of a seed."""
    words: tuple[str, ...] = ("run", sweep.scenario)
    if sweep.cell:
        words += ("--cell", sweep.cell)
    if sweep.policy:
        words = ("evaluate", sweep.policy, sweep.scenario, "--trials", "1")
    return command(*words, "--seed", str(seed), overrides=sweep.overrides)


def _date(sweep: SweepInfo) -> str:
    try:
        started = datetime.datetime.fromisoformat(sweep.started)
    except ValueError:
        return sweep.started or "at an unknown time"
    return f"{started:%Y-%m-%d %H:%M %Z}".rstrip()
