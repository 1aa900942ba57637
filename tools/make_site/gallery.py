"""The gallery: replays of runs made for it, and the figures of experiments."""

from __future__ import annotations

import shutil
from pathlib import Path

from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.sweeps.info import sources_hash
from experiments import find_experiments
from make_site.systems import ROOT

# The runs whose replays the gallery shows. The notebook of the arm shows its, too.
RUNS = ("kitchen", "assistive_arm", "clear_table_fast", "sort_table", "insert")


def figures() -> str:
    """Return the figure of every experiment, with a link to its page."""
    cards = [
        f"[![{found.description}](experiments/{name}.png)](experiments/{name}.md)\n\n"
        f"[{name}](experiments/{name}.md): {found.description}"
        for name, found in find_experiments().items()
        if (ROOT / f"docs/experiments/{name}.png").is_file()
    ]
    boxes = "\n".join(f"```{{container}}\n{card}\n```\n" for card in cards)
    return f"````{{container}} gallery\n{boxes}````"


def record_replays(folder: Path, target: Path) -> None:
    """Simulate the runs of the gallery, and copy their replays to `target`.

    A run of the same code and scenario is not repeated.

    Args:
        folder: For the runs.
        target: For the pages NAME.html.

    Raises:
        RuntimeError: If a run does not succeed.
    """
    target.mkdir(parents=True, exist_ok=True)
    for name in RUNS:
        out = folder / sources_hash() / name
        page = out / "replay.html"
        if not page.is_file():
            result = Simulate(load_scenario(name), name=name, out=out, progress=True)
            if not result.metrics.success:
                raise RuntimeError(f"gallery: {name}: {result.metrics.failure}")
        shutil.copyfile(page, target / f"{name}.html")
