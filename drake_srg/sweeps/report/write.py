"""Writes the results of a sweep into one self-contained HTML page."""

from __future__ import annotations

import datetime
import functools
import importlib.resources
from pathlib import Path
from xml.etree import ElementTree

from drake_srg.common.exceptions import ScenarioError
from drake_srg.recording.output import OutputFile
from drake_srg.sweeps.report import page
from drake_srg.sweeps.report.causes import effects
from drake_srg.sweeps.report.elements import (
    Element,
    code,
    definitions,
    element,
    folded,
    paragraph,
    section,
)
from drake_srg.sweeps.report.replays import find_replays
from drake_srg.sweeps.report.trials import Trials, command
from drake_srg.sweeps.report.worst import worst
from drake_srg.sweeps.rows import SweepInfo, read_rows, read_sweep, sampled_columns

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
