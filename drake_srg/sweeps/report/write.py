"""The report of a sweep: one self-contained HTML page."""

from __future__ import annotations

import base64
import datetime
import functools
import importlib.resources
import os
import urllib.parse
from collections.abc import Callable, Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.recording.output import OutputFile
from drake_srg.sweeps.report import page
from drake_srg.sweeps.report.elements import (
    Element,
    code,
    definitions,
    element,
    folded,
    number,
    paragraph,
    section,
    table,
)
from drake_srg.sweeps.report.page import effects
from drake_srg.sweeps.report.trials import Trials, command
from drake_srg.sweeps.rows import SweepInfo, read_rows, read_sweep, sampled_columns

_MOST = 100  # links in the list


def find_replays(trials: Trials, folder: Path, page: Path) -> dict[int, str]:
    """Return links to the replays of recorded trials by row, the worst first.

    Args:
        trials: All trials.
        folder: Folder of the sweep.
        page: The report, from which the links lead.
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


def replay_link(links: Mapping[int, str], row: int, text: str) -> Element | str:
    """Return a link to a trial's replay, or a dash if it was not recorded."""
    if row not in links:
        return "–"
    return element("a", text, href=links[row])


def replay_list(trials: Trials, links: Mapping[int, str]) -> list[Element]:
    """Return a paragraph of links to all replays; nothing if there are none."""
    if not links:
        return []
    shown = list(links)[:_MOST]
    words = "Replays in 3D, the worst first: trials "
    parts: list[Element | str] = [words]
    for row in shown:
        parts += [replay_link(links, row, f"{trials.trial[row]}"), ", "]
    rest = len(links) - len(shown)
    parts[-1] = f", and {rest:,} more in recordings/." if rest else "."
    return [element("p", *parts)]


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


# The page loads nothing, whatever text it contains.
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; media-src data:"


def write_report(folder: Path | str, output: Path | str | None = None) -> Path:
    """Write the report of a sweep, finished or not; returns its path.

    Args:
        folder: Folder of the sweep.
        output: The .html file; None: report.html in `folder`.

    Raises:
        ScenarioError: If there is no sweep, no trial has finished, or a row or a video
            cannot be read.
        OSError: If the page cannot be written.
    """
    folder = Path(folder)
    sweep = read_sweep(folder)
    table = read_rows(folder)
    if not table.num_rows:
        raise ScenarioError(f"{folder}: no trial has finished yet")
    path = folder / "report.html" if output is None else Path(output)
    html = _page(sweep, Trials(table, sampled_columns(table)), folder, path)
    file = OutputFile(path)
    file.path.write_text(
        "<!DOCTYPE html>\n" + ElementTree.tostring(html, "unicode", "html") + "\n",
        encoding="utf-8",
        errors="replace",  # file names need not be UTF-8
    )
    return file.commit()


def _page(sweep: SweepInfo, trials: Trials, folder: Path, path: Path) -> Element:
    rerun = functools.partial(_rerun, sweep)
    style = importlib.resources.files(__package__).joinpath("report.css")
    return element(
        "html",
        element(
            "head",
            element("meta", charset="utf-8"),
            element("meta", http_equiv="Content-Security-Policy", content=_POLICY),
            element(
                "meta", name="viewport", content="width=device-width, initial-scale=1"
            ),
            element("title", f"{sweep.scenario}: {len(trials):,} trials"),
            element("style", style.read_text(encoding="utf-8")),
        ),
        element(
            "body",
            element("header", *_header(sweep, trials)),
            element(
                "main",
                page.summary(trials),
                page.failures(trials, rerun),
                effects(trials),
                page.distributions(trials),
                worst(trials, folder, rerun, find_replays(trials, folder, path)),
                page.totals(trials, sweep.jobs),
                _origin(sweep),
            ),
        ),
        lang="en",
    )


def _header(sweep: SweepInfo, trials: Trials) -> list[Element]:
    words = ("evaluate", sweep.policy) if sweep.policy else ("sweep",)
    repeat = command(
        *(*words, sweep.scenario, "--trials", str(sweep.trials)),
        *("--seed", str(sweep.seed)),
        *(("--cell", sweep.cell) if sweep.cell else ()),
        overrides=sweep.overrides,
    )
    done = f"{len(trials):,} trials"
    lines = [
        element("h1", sweep.scenario),
        paragraph(f"{done}, seed {sweep.seed}, started {_date(sweep)}"),
        element("pre", code(repeat), class_="command"),
    ]
    if len(trials) < sweep.trials:
        lines.append(
            element(
                "p",
                f"{len(trials):,} of {sweep.trials:,} trials have finished: the sweep "
                "is still running or was interrupted. Quick trials may be "
                "over-represented. To finish an interrupted sweep, add ",
                code("--resume"),
                " and its ",
                code("--out"),
                " to the command above.",
                class_="notice",
                role="note",
            )
        )
    return lines


def _rerun(sweep: SweepInfo, seed: int) -> str:
    words: tuple[str, ...] = ("run", sweep.scenario)
    if sweep.cell:
        words += ("--cell", sweep.cell)
    if sweep.policy:
        words = ("evaluate", sweep.policy, sweep.scenario, "--trials", "1")
    return command(*words, "--seed", str(seed), overrides=sweep.overrides)


def _engine(sweep: SweepInfo) -> str:
    jobs = "" if sweep.jobs is None else f", {sweep.jobs} at a time"
    return f"{sweep.engine}{jobs}"


def _date(sweep: SweepInfo) -> str:
    try:
        started = datetime.datetime.fromisoformat(sweep.started)
    except ValueError:
        return sweep.started or "at an unknown time"
    return f"{started:%Y-%m-%d %H:%M %Z}".rstrip()


def _origin(sweep: SweepInfo) -> Element:
    versions = ", ".join(f"{name} {is_}" for name, is_ in sweep.versions.items())
    return section(
        "Scenario and versions",
        definitions(
            [
                ("Scenario", sweep.scenario),
                ("Overrides", " ".join(sweep.overrides) or "none"),
                ("Versions", versions),
                ("Engine", _engine(sweep)),
                ("Started", _date(sweep)),
            ]
        ),
        folded("The complete scenario", element("pre", code(sweep.tree))),
    )
