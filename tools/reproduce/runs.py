"""Runs experiments one after another, each in a process of its own."""

from __future__ import annotations

import dataclasses as dc
import multiprocessing as mp
import sys
import time as wall
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from drake_srg.cli.command import end_on_sigterm
from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.experiments.registry import run_experiment
from reproduce.page import show_time
from reproduce.stamps import RESULT, Stamp, current_stamp, make_stamp, write_stamp


@dc.dataclass(frozen=True)
class Run:
    """An experiment that was to be run.

    Attributes:
        name: Of the experiment.
        stamp: Of its result; None if there is no result.
        error: Why there is no result, in one line.
    """

    name: str
    stamp: Stamp | None
    error: str = ""


def run_all(
    names: Sequence[str],
    out: Path,
    durations: Mapping[str, float],
    say: Callable[[str], None],
) -> Iterator[Run]:
    """Run experiments, and yield each when it has ended, well or not.

    A result that the same code made before is used again.

    Args:
        names: Of the experiments.
        out: The folder for a folder of results for each of them.
        durations: What runs took before, by name [s].
        say: Shows a line of progress.
    """
    kept = {name: stamp for name in names if (stamp := current_stamp(out / name))}
    waiting = [name for name in names if name not in kept]
    if kept:
        say(f"made by this code before: {', '.join(kept)}")
    for name, stamp in kept.items():
        yield Run(name, stamp)
    for i, name in enumerate(waiting):
        say(f"[{i + 1}/{len(waiting)}] {name} ({remaining(waiting[i:], durations)})")
        start = wall.perf_counter()
        error = in_process(run_quietly, name, out / name)
        if error:
            say(f"{name}: no result: {error}")
            yield Run(name, None, error)
            continue
        stamp = make_stamp(out / name / RESULT, wall.perf_counter() - start)
        write_stamp(out / name, stamp)
        yield Run(name, stamp)


def remaining(names: Sequence[str], durations: Mapping[str, float]) -> str:
    """Return how much work is left, in words."""
    known = [durations[name] for name in names if name in durations]
    unknown = len(names) - len(known)
    texts = [f"about {show_time(sum(known))}"] if known else []
    texts += [f"{unknown} of unknown duration"] if unknown else []
    return f"{' and '.join(texts)} to go"


def in_process(function: Callable[..., str], *arguments: object) -> str:
    """Return what a function returns in a process of its own.

    An experiment can end its process, as Drake does where an assertion fails, and can
    leave behind nodes, threads and memory that change the next one's times.
    """
    context = mp.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        try:
            return pool.submit(function, *arguments).result()
        except BrokenProcessPool:
            return "its process ended without a message"
        except KeyboardInterrupt:
            for child in mp.active_children():  # a SIGTERM has reached us alone
                child.terminate()
            raise


def run_quietly(name: str, out: Path) -> str:
    """Run an experiment; returns why it has no result, or nothing."""
    end_on_sigterm()
    try:
        run_experiment(name, out, progress=sys.stderr.isatty())
    except ScenarioError as error:  # says it all
        return one_line(error)
    except (Exception, SystemExit) as error:
        traceback.print_exc()
        return f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"
    return ""
