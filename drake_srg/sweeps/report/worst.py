"""The section of a report that shows the worst trials, and their videos."""

from __future__ import annotations

import base64
from collections.abc import Callable
from pathlib import Path

import numpy as np

from drake_srg.sweeps.report.elements import (
    Element,
    code,
    element,
    number,
    paragraph,
    section,
    table,
)
from drake_srg.sweeps.report.trials import Trials

_ROWS = 10
_VIDEOS = 8
VIDEO_BYTES = 24_000_000  # of all of them: what one can still send by mail


def worst(trials: Trials, folder: Path, rerun: Callable[[int], str]) -> Element:
    """The worst trials in a table, and the videos of those that were recorded.

    Args:
        trials: All of them.
        folder: Of the sweep.
        rerun: Gives the command that repeats the trial of a seed.
    """
    rows = trials.worst()
    videos, left_out = _videos(trials, folder)
    if videos:
        shown = "Videos of the worst of those that were recorded."
        if left_out:
            shown += f" {len(left_out):,} more are in the sweep's folder, as "
            shown += f"{', '.join(left_out[:3])}{', …' if left_out[3:] else '.'}"
    else:
        shown = (
            "No recordings here. `drake-srg sweep --record failures` keeps those of "
            "failed trials; the commands record theirs, too."
        )
    return section(
        "Worst trials",
        paragraph("Failed trials first, then those with the largest placement error."),
        table(
            ["Trial", "Result", "Placement error", "Cycle time", "Attempts", "Repeat"],
            [
                (
                    f"{trials.trial[row]}",
                    "success" if trials.success[row] else code(trials.failure[row]),
                    number(1e3 * trials.placement_error[row], "mm"),
                    number(trials.cycle_time[row], "s"),
                    number(trials.attempts[row]),
                    code(rerun(trials.seed[row])),
                )
                for row in rows[:_ROWS]
            ],
            "Worst trials",
        ),
        paragraph(shown),
        element("div", *(_player(trials, r, v) for r, v in videos), class_="videos"),
    )


def _videos(trials: Trials, folder: Path) -> tuple[list[tuple[int, bytes]], list[str]]:
    """The videos to show, the worst trial's first, and the paths of the others."""
    shown: list[tuple[int, bytes]] = []
    left_out: list[str] = []
    room = VIDEO_BYTES
    for row in trials.worst():
        name = f"recordings/{trials.trial[row]:06d}/video.mp4"
        path = folder / name
        if not path.is_file():
            continue
        size = path.stat().st_size
        if len(shown) < _VIDEOS and size <= room:
            shown.append((row, path.read_bytes()))
            room -= size
        else:
            left_out.append(name)
    return shown, left_out


def _player(trials: Trials, row: int, video: bytes) -> Element:
    what = "success" if trials.success[row] else trials.failure[row]
    if trials.claimed[row]:
        what += ", though the planner said done"
    if trials.message[row]:
        what += f": {trials.message[row]}"
    error = trials.placement_error[row]
    if np.isfinite(error):
        what += f"; {number(1e3 * error, 'mm')} from its goal"
    name = f"Trial {trials.trial[row]}, seed {trials.seed[row]}"
    data = base64.b64encode(video).decode()
    return element(
        "figure",
        element(
            "video",
            f"Video of trial {trials.trial[row]}; this browser does not show it.",
            controls="",
            preload="metadata",
            src=f"data:video/mp4;base64,{data}",
            aria_label=f"Video of {name}: {what}",
        ),
        element(
            "figcaption",
            element("strong", name),
            element("span", what, class_="words"),
        ),
    )
