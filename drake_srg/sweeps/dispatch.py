"""Gives trials to an engine, again if their worker dies."""

from __future__ import annotations

import collections
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.sweeps.engines import Engine
from drake_srg.sweeps.trial import TrialResult

# After so many dead workers, the trial is to blame: two may have died of another trial
# beside it, and it has to die alone twice, because one death may be its worker's.
TRIES = 4
# After so many deaths per slot without a single result, no trial is to blame.
_DEATHS = 5


def dispatch(
    engine: Engine,
    trials: Iterable[int],
    submit: Callable[[int], Future[TrialResult]],
    lost: Callable[[int, str], TrialResult],
) -> Iterator[TrialResult]:
    """Run trials and yield their results as they arrive, each exactly once.

    A dying worker may take others with it, so its trials simply run again. A trial that
    dies a second time waits until all others have finished, and then runs alone, so
    that only the one to blame dies again.

    Args:
        engine: Runs the trials.
        trials: Their numbers.
        submit: Gives a trial to the engine.
        lost: Makes the result of a trial whose workers keep dying, from the reason.

    Raises:
        ScenarioError: If workers keep dying without a result, or a trial cannot read
            or write a file.
        Exception: Any other exception of a trial.
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
                        f"workers keep dying, {deaths} times without a result: {reason}"
                    ) from error
                if tries[trial] < TRIES:
                    if tries[trial] == 1:
                        waiting.append(trial)
                    elif tries[trial] == 2:
                        suspects.append(trial)
                    else:
                        suspects.appendleft(trial)  # whose result resets `deaths`
                    continue
                result = lost(trial, f"its worker died {TRIES} times: {reason}")
            except Exception as error:
                cause = _cause(error)
                if isinstance(
                    cause, OSError
                ):  # the trial's, not one of writing the sweep
                    raise ScenarioError(
                        f"trial {trial}: {_words(cause)}; finished trials are kept, "
                        "--resume continues"
                    ) from error
                raise cause from error
            deaths = 0
            fill()  # first, because the caller takes time to write the result
            yield result
        fill()


def _words(error: OSError) -> str:
    """Return in one line what went wrong, and with which file."""
    if error.strerror is None:
        return one_line(error)
    return f"{error.filename}: {error.strerror}" if error.filename else error.strerror


def _cause(error: Exception) -> Exception:
    """Return a worker's own exception, which Ray wraps."""
    inner: Any = getattr(error, "cause", None)
    return inner if isinstance(inner, Exception) else error
