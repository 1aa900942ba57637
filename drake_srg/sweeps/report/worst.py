"""The section of a report that shows the worst trials, and their videos."""

from __future__ import annotations

import base64
from collections.abc import Callable
from pathlib import Path

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.sweeps.report.elements import (
    Element,
    code,
    element,
    number,
    paragraph,
    section,
    table,
)
from drake_srg.sweeps.report.replays import replay_link, replay_list
from drake_srg.sweeps.report.trials import Trials

_ROWS = 10
_VIDEOS = 8
VIDEO_BYTES = 24_000_000  # of all videos, so that the page can be sent by mail


def worst(
    trials: Trials, folder: Path, rerun: Callable[[int], str], replays: dict[int, str]
) -> Element:
    """Return the section with the worst trials, their replays and videos if recorded.

    Args:
        trials: All trials.
        folder: Folder of the sweep.
        rerun: Returns the command that repeats the trial of a seed.
        replays: From `find_replays`.

    Raises:
        ScenarioError: If a video cannot be read.
    """
    rows = trials.worst()
    videos, left_out = _videos(trials, folder)
    if videos:
        shown = "Videos of the worst recorded trials."
        if left_out:
            shown += f" {len(left_out):,} more are in the sweep's folder: "
            shown += f"{', '.join(left_out[:3])}{', …' if left_out[3:] else '.'}"
    else:
        shown = (
            "No trial was recorded. `drake-srg sweep --record failures` records failed "
            "trials; the commands above record a single one."
        )
    return section(
        "Worst trials",
        paragraph("Failed trials first, then those with the largest placement error."),
        table(
            [
                "Trial",
                "Result",
                "Placement error",
                "Cycle time",
                "Attempts",
                "Replay",
                "Repeat it",
            ],
            [
                (
                    f"{trials.trial[row]}",
                    "success" if trials.success[row] else code(trials.failure[row]),
                    number(1e3 * trials.placement_error[row], "mm"),
                    number(trials.cycle_time[row], "s"),
                    number(trials.attempts[row]),
                    replay_link(replays, row, "replay"),
                    code(rerun(trials.seed[row])),
                )
                for row in rows[:_ROWS]
            ],
            "Worst trials",
        ),
        *replay_list(trials, replays),
        paragraph(shown),
        element("div", *(_player(trials, r, v) for r, v in videos), class_="videos"),
    )


def _videos(trials: Trials, folder: Path) -> tuple[list[tuple[int, bytes]], list[str]]:
    """Return row and video of the trials to show, and the paths of other videos."""
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
            shown.append((row, _read(path)))
            room -= size
        else:
            left_out.append(name)
    return shown, left_out


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from error


def _player(trials: Trials, row: int, video: bytes) -> Element:
    what = "success" if trials.success[row] else trials.failure[row]
    if trials.claimed[row]:
        what += ", although the planner reported done"
    if trials.message[row]:
        what += f": {trials.message[row]}"
    error = trials.placement_error[row]
    if np.isfinite(error):
        what += f"; {number(1e3 * error, 'mm')} from the goal"
    name = f"Trial {trials.trial[row]}, seed {trials.seed[row]}"
    data = base64.b64encode(video).decode()
    return element(
        "figure",
        element(
            "video",
            f"Video of trial {trials.trial[row]}; this browser cannot play it.",
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
