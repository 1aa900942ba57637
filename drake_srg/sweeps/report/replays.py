"""Links from a report to the replays of recorded trials."""

from __future__ import annotations

import os
import urllib.parse
from collections.abc import Mapping
from pathlib import Path

from drake_srg.sweeps.report.elements import Element, element
from drake_srg.sweeps.report.trials import Trials

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
