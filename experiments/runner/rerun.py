"""Reruns experiments and compares their rows with the committed ones.

`make experiments` runs it. docs/experiments holds the committed results: NAME.json is
the result.json of an experiment and NAME.png its picture; stamps.json says what each
was made with. The pages of the site are made from these files alone.
"""

from __future__ import annotations

import argparse
import dataclasses as dc
import math
import subprocess
import sys
import time as wall
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drake_srg.cli.command import (
    BAD_INPUT,
    INTERRUPTED,
    SUCCESS,
    TASK_FAILED,
    end_on_signals,
)
from drake_srg.common.exceptions import ScenarioError
from experiments import find_experiments
from experiments.runner.claims import Row
from experiments.runner.committed import (
    Change,
    accept,
    committed_rows,
    compare,
    current_stamp,
    drake_version,
    make_stamp,
    read_rows,
    read_stamps,
    show_time,
    slowdown,
    write_stamp,
)
from experiments.runner.experiment import chosen
from experiments.runner.page import write_quoting_pages
from experiments.runner.run import RESULT, align
from experiments.runner.sources import ROOT

OUT = ROOT / "out" / "experiments"
QUICK = 60.0  # how long the quick experiments may take together [s]


def main(arguments: Sequence[str] | None = None) -> int:
    """Rerun experiments; returns the exit code.

    Exit codes: 0, every row is as committed; 1, a row fails, moved, appeared or
    vanished, or an experiment has no result; 2, bad input.
    """
    parser = argparse.ArgumentParser(
        prog="experiments all",
        description="Rerun experiments and compare them with the committed rows.",
    )
    add, flag = parser.add_argument, dict[str, Any](action="store_true")
    name: dict[str, Any] = {"nargs": "+", "default": [], "metavar": "NAME"}
    add("--only", help="run these only", **name)
    add("--except", dest="left_out", help="leave these out", **name)
    add(
        "--quick",
        help=f"run the shortest only, about {QUICK:.0f} s in all, and do not "
        "compare wall-clock values, because other programs may run",
        **flag,
    )
    add("--accept", help="put the new results into docs", **flag)
    options = parser.parse_args(arguments)
    end_on_signals()
    try:
        return rerun(options)
    except (ScenarioError, OSError) as error:
        say(f"experiments: {error}")
        return BAD_INPUT
    except KeyboardInterrupt:
        say("experiments: stopped; the next call goes on from here")
        return INTERRUPTED


def rerun(options: argparse.Namespace) -> int:
    """Run, compare and report as the options say; returns the exit code."""
    stamps = read_stamps()
    durations = {name: stamp.seconds for name, stamp in stamps.items()}
    names = choose(list(find_experiments()), options.only, options.left_out)
    if options.quick:
        names = shortest(names, durations, QUICK)
    if not names:
        raise ScenarioError("no experiment to run (--quick needs committed results)")
    old = {name: committed_rows(name) for name in names}
    if others := {stamps[n].drake for n in names if n in stamps} - {drake_version()}:
        say(f"Drake {drake_version()}; rows are of Drake {', '.join(others)}")
    report, made = Report(), {}
    for i, name in enumerate(names):
        say(f"[{i + 1}/{len(names)}] {name} ({remaining(names[i:], durations)})")
        stamp = current_stamp(OUT / name)
        if stamp is None:
            start = wall.perf_counter()
            if error := run_apart(name, OUT / name):
                say(f"{name}: no result: {error}")
                report.missing[name] = error
                continue
            stamp = make_stamp(OUT / name, wall.perf_counter() - start)
            write_stamp(OUT / name, stamp)
        made[name] = stamp
        rows = read_rows(OUT / name / RESULT)
        compared, before = rows, old[name]
        if options.quick:  # others may use the machine at the same time
            compared = [row for row in rows if not row.clock]
            before = before and [row for row in before if not row.clock]
        report.add(name, before, compared)
        say(f"{name}: {len(rows)} rows, {len(report.changes[name])} failed or changed")
    if options.accept:
        accept(made, OUT)
        write_quoting_pages()
        report.accepted = True
    print(report.text())
    return SUCCESS if report.good else TASK_FAILED


def say(text: str) -> None:
    """Show progress."""
    print(text, file=sys.stderr, flush=True)


def choose(
    names: Sequence[str], only: Sequence[str], left_out: Sequence[str]
) -> list[str]:
    """Return the names to run, in order; an unknown one is a ScenarioError."""
    wanted = chosen("--only", only, names)
    chosen("--except", left_out, names)
    return [name for name in names if name in wanted and name not in left_out]


def shortest(
    names: Sequence[str], durations: Mapping[str, float], budget: float
) -> list[str]:
    """Return as many of the shortest experiments as fit into a budget [s].

    Those without the duration of a committed run are not chosen.
    """
    known = sorted(set(names) & durations.keys(), key=lambda name: durations[name])
    total = np.cumsum([durations[name] for name in known])
    few = known[: np.searchsorted(total, budget, side="right")]
    return [name for name in names if name in few]


def remaining(names: Sequence[str], durations: Mapping[str, float]) -> str:
    """Return the remaining work, in words."""
    known = [durations[name] for name in names if name in durations]
    unknown = len(names) - len(known)
    more = f" and {unknown} of unknown duration" * bool(unknown)
    return f"about {show_time(sum(known))}{more} to go"


def run_apart(name: str, out: Path) -> str:
    """Run an experiment in a process of its own; return why it has no result, or "".

    An experiment can end its process, as Drake does where an assertion fails, and can
    leave behind nodes, threads and memory that change the next one's times.
    """
    command = [sys.executable, "-m", "experiments", name, "--out", str(out)]
    (out / RESULT).unlink(missing_ok=True)
    process = subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    try:
        lines = [line.rstrip() for line in process.stderr]
        code = process.wait()
    except BaseException:  # which may have reached us alone
        process.terminate()
        process.wait()
        raise
    if code in (SUCCESS, TASK_FAILED) and (out / RESULT).exists():
        return ""
    said = [line for line in lines if line]
    return said[-1] if said else "its process ended without a message"


@dc.dataclass
class Report:
    """Outcome of a rerun of experiments."""

    # By experiment: rows that somebody must look into; why there is no result; and,
    # where that is measured, how many times as long it took as the committed run.
    changes: dict[str, list[Change]] = dc.field(default_factory=dict)
    missing: dict[str, str] = dc.field(default_factory=dict)
    slowdowns: dict[str, float] = dc.field(default_factory=dict)
    uncommitted: list[str] = dc.field(default_factory=list)  # without a result so far
    accepted: bool = False  # whether the new rows are the committed ones by now

    def add(self, name: str, old: Sequence[Row] | None, new: Sequence[Row]) -> None:
        """Compare the rows of an experiment with the committed ones, if any."""
        self.changes[name] = compare(old, new)
        if old is None:
            self.uncommitted.append(name)
        elif any(row.clock for row in new):
            self.slowdowns[name] = slowdown(old, new)

    @property
    def good(self) -> bool:
        """Whether all experiments ran, all rows pass and the docs are up to date."""
        wrong = {c.what for changes in self.changes.values() for c in changes}
        if self.accepted:
            return not (self.missing or "failed" in wrong)
        return not (self.missing or self.uncommitted or wrong)

    def text(self) -> str:
        """Return the report as text."""
        lines = [changes_table(self.changes)] if any(self.changes.values()) else []
        lines += [
            f"{name}: took {factor:.2f} times as long as the committed run, by which "
            "its wall-clock values are corrected"
            for name, factor in self.slowdowns.items()
        ]
        lines += [f"{name}: NOT RUN: {error}" for name, error in self.missing.items()]
        if not self.accepted:
            lines += [f"{name}: no committed result yet" for name in self.uncommitted]
        rows = sum(map(len, self.changes.values()))
        total = len(self.changes) + len(self.missing)
        lines.append(
            f"{len(self.changes)} of {total} experiments ran; {rows} rows "
            f"{'failed or changed' if rows else 'changed by more than their spread'}"
        )
        if self.accepted:
            lines.append("the new rows are in docs now: look at them, then commit")
        elif rows or self.uncommitted:
            lines.append("ACCEPT=1 puts the new rows into docs")
        return "\n".join(lines)


def changes_table(changes: Mapping[str, Sequence[Change]]) -> str:
    """Return changed rows, by experiment, as aligned text."""

    def number(value: float) -> str:
        return f"{value:.4g}" if math.isfinite(value) else "-"

    lines = [("experiment", "row", "quantity", "old", "new", "spread", "unit", "")]
    for name, own in changes.items():
        for change in own:
            row, what = change.row, str(change.what)
            if change.what == "failed":
                what += f": {row.expected}"
            numbers = (number(change.old), number(change.new), f"{row.spread:.2g}")
            lines.append((name, row.name, row.quantity, *numbers, row.unit, what))
    return align(lines)
