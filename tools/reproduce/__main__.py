"""The command behind `make experiments`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Mapping, Sequence

from drake_srg.cli.command import (
    BAD_INPUT,
    INTERRUPTED,
    SUCCESS,
    TASK_FAILED,
    end_on_sigterm,
)
from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments.registry import (
    find_experiment,
    list_experiments,
    list_measurements,
)
from reproduce.committed import Committed, read_rows
from reproduce.report import Report
from reproduce.runs import run_all
from reproduce.stamps import RESULT, ROOT, drake_version

DOCS, OUT = ROOT / "docs", ROOT / "out" / "experiments"
QUICK = 60.0  # how long the quick experiments may take together [s]


def main(arguments: Sequence[str] | None = None) -> int:
    """Rerun experiments; returns the exit code.

    Exit codes: 0, every figure is as committed; 1, a row fails, moved, appeared or
    vanished, or an experiment has no result; 2, bad input.
    """
    options = make_parser().parse_args(arguments)
    end_on_sigterm()
    try:
        return reproduce(options)
    except (ScenarioError, OSError) as error:
        say(f"experiments: {error}")
        return BAD_INPUT
    except KeyboardInterrupt:
        say("experiments: stopped; the next call goes on from here")
        return INTERRUPTED


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="experiments",
        description="Rerun experiments and compare them with the committed figures.",
    )
    for option, target, what in (
        ("--only", "only", "run these only"),
        ("--except", "left_out", "leave these out"),
    ):
        parser.add_argument(
            option, dest=target, nargs="+", default=[], metavar="NAME", help=what
        )
    parser.add_argument(
        "--quick",
        action="store_true",
        help=f"run the shortest only, about {QUICK:.0f} s in all",
    )
    parser.add_argument(
        "--accept", action="store_true", help="put the new figures into docs"
    )
    return parser


def reproduce(options: argparse.Namespace) -> int:
    """Run, compare and report as the options say; returns the exit code.

    Raises:
        ScenarioError: If an experiment is unknown, none is left to run, or the
            committed figures cannot be read.
        OSError: If results cannot be written.
    """
    committed = Committed(DOCS)
    stamps = committed.stamps()
    durations = {name: stamp.seconds for name, stamp in stamps.items()}
    descriptions = {**list_experiments(), **list_measurements()}
    names = choose(descriptions, options.only, options.left_out)
    if options.quick:
        names = shortest(names, durations, QUICK)
    if not names:
        raise ScenarioError("no experiment to run (--quick needs committed figures)")
    old = {name: committed.rows(name) for name in names}
    committed.render(descriptions)  # better to fail now than after hours
    if others := {stamps[n].drake for n in names if n in stamps} - {drake_version()}:
        say(f"Drake {drake_version()}; figures are of Drake {', '.join(others)}")
    report, made = Report(), {}
    for run in run_all(names, OUT, durations, say):
        if run.stamp is None:
            report.missing[run.name] = run.error
        else:
            made[run.name] = run.stamp
            rows = read_rows(OUT / run.name / RESULT)
            report.add(run.name, old[run.name], rows)
            wrong = len(report.changes[run.name])
            say(f"{run.name}: {len(rows)} rows, {wrong} failed or changed")
    if options.accept:
        committed.accept(made, OUT, descriptions)
        report.accepted = True
    print(report.text())
    return SUCCESS if report.good else TASK_FAILED


def choose(
    names: Iterable[str], only: Sequence[str], left_out: Sequence[str]
) -> list[str]:
    """Return the names to run, in order.

    Raises:
        ScenarioError: If a name is unknown.
    """
    for name in (*only, *left_out):
        find_experiment(name)
    return [n for n in names if n not in left_out and (not only or n in only)]


def shortest(
    names: Sequence[str], durations: Mapping[str, float], budget: float
) -> list[str]:
    """Return as many of the shortest experiments as fit into a budget [s].

    Args:
        names: To choose from.
        durations: Of the committed runs, by name [s]. Others are not chosen.
        budget: For all of them [s].
    """
    chosen, total = set(), 0.0
    for name in sorted(set(names) & durations.keys(), key=lambda n: durations[n]):
        total += durations[name]
        if total > budget:
            break
        chosen.add(name)
    return [name for name in names if name in chosen]


def say(text: str) -> None:
    """Show progress."""
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
