"""Gives trials to an engine, and gives them out again where a worker dies."""

from __future__ import annotations

import collections
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.sweeps.engines import Engine
from drake_srg.sweeps.trial import TrialResult

# How often a trial is given out before it is blamed for the deaths of its workers.
TRIES = 3
# So many deaths on each slot without a result between them are no trial's fault.
_DEATHS = 5


def dispatch(
    engine: Engine,
    trials: Iterable[int],
    submit: Callable[[int], Future[TrialResult]],
    lost: Callable[[int, str], TrialResult],
) -> Iterator[TrialResult]:
    """Run trials and yield what comes of them as it comes, each exactly once.

    A worker's death may take others with it: those trials run again among the others.
    What dies a second time waits until all else is done, and runs alone then, so that
    only the guilty one dies again.

    Args:
        engine: Runs them.
        trials: Their numbers.
        submit: Gives one to the engine.
        lost: Makes the result of a trial whose workers keep dying, from the reason.

    Raises:
        ScenarioError: If workers die and nothing else happens, or have no files.
        Exception: What a trial raised.
    """
    waiting = collections.deque(trials)
    suspects: collections.deque[int] = collections.deque()
    tries: collections.Counter[int] = collections.Counter()
    pending: dict[Future[TrialResult], int] = {}
    deaths = 0

    def fill() -> None:
        while waiting and len(pending) < engine.slots():
            trial = waiting.popleft()
            pending[submit(trial)] = trial
        if suspects and not pending:
            trial = suspects.popleft()
            pending[submit(trial)] = trial

    fill()
    while pending:
        for future in wait(pending, return_when=FIRST_COMPLETED).done:
            trial = pending.pop(future)
            try:
                result = future.result()
            except engine.deaths as error:
                deaths += 1
                tries[trial] += 1
                reason = one_line(error)
                if deaths >= _DEATHS * engine.slots():
                    raise ScenarioError(
                        f"workers keep dying, {deaths} without a result: {reason}"
                    ) from error
                if tries[trial] < TRIES:
                    (waiting if tries[trial] == 1 else suspects).append(trial)
                    continue
                result = lost(trial, f"its worker died {TRIES} times: {reason}")
            except Exception as error:
                cause = _cause(error)
                if isinstance(cause, OSError):  # it is not the caller's own
                    raise ScenarioError(
                        f"trial {trial}: {_words(cause)}; what is done stays, --resume "
                        "goes on"
                    ) from error
                raise cause from error
            deaths = 0
            fill()  # before the caller takes its time to write
            yield result
        fill()


def _words(error: OSError) -> str:
    """What went wrong in a line, and with which file."""
    if error.strerror is None:
        return one_line(error)
    return f"{error.filename}: {error.strerror}" if error.filename else error.strerror


def _cause(error: Exception) -> Exception:
    """Return what went wrong in a worker, of an error that Ray wraps."""
    inner: Any = getattr(error, "cause", None)
    return inner if isinstance(inner, Exception) else error
