"""Trials and an engine that take no time, for the tests of sweeps."""

import errno
import os
import signal
import time
from concurrent.futures import BrokenExecutor, Future
from pathlib import Path

from drake_srg.sweeps.sweep import run_sweep
from drake_srg.sweeps.trial import TrialResult, empty_row

SCENARIO = "kitchen_fast"
MASS = "objects.soup_can.mass"


def names(folder):
    """Names of the files in a folder."""
    return sorted(path.name for path in folder.iterdir())


def trial(tree, origin, seed, trial, record):
    """A trial; every third one fails, and leaves a recording if `record` says so."""
    row = empty_row(seed, trial, None)
    success = trial % 3 != 1
    row |= {
        "success": success,
        "failure": None if success else "dropped",
        "claimed": trial % 2 == 0,
        "grasp_lifted": True,
        "time_to_placement_s": 3.0 + trial,
        "cycle_time_s": 5.0 + trial,
        MASS: 0.1 * (seed + trial),
        "worker": str(os.getpid()),
    }
    kept = record == "all" or (record == "failures" and not success)
    return TrialResult(row, {"video.mp4": b"%d" % trial} if kept else {})


def deadly(tree, origin, seed, trial_number, record):
    """A trial; trial 2 always kills its worker, trial 5 the first one, with a note."""
    note = Path(tree["note"])
    if trial_number == 5 and not note.exists():
        note.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if trial_number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return trial(tree, origin, seed, trial_number, record)


def environment(name):
    return os.environ.get(name)


def unchecked(tree, scenario, seed, record, cell=""):
    """Stands in for `check_scenario`, which takes a second to build the cell."""
    return seed or 0


class StubEngine:
    """Runs functions at once in this process; `dying` says how often trials die."""

    name = "stub"
    jobs = 2
    deaths = (BrokenExecutor,)
    shares_files = True

    def __init__(self, dying=None):
        self.dying = dict(dying or {})
        self.given = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def slots(self):
        return 2

    def submit(self, function, *arguments):
        trial = arguments[3]
        self.given.append(trial)
        future = Future()
        if self.dying.get(trial, 0) > 0:
            self.dying[trial] -= 1
            future.set_exception(BrokenExecutor("SIGKILL(-9)"))
            return future
        try:
            future.set_result(function(*arguments))
        except Exception as error:
            future.set_exception(error)
        return future


class Drawn:
    """Stands in for a drawn scenario, of which only the drawn values are used."""

    def __init__(self, *_):
        self.values = {MASS: 1.0}


def slow(*arguments):
    time.sleep(0.5)
    return trial(*arguments)


def no_space(*_, **__):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def run(out, engine=None, told=None, **changes):
    """Run a sweep of six stub trials, or with changes; `told` collects warnings."""
    arguments = {"scenario": SCENARIO, "trials": 6, "trial_function": trial}
    return run_sweep(
        out=out,
        engine=engine or StubEngine(),
        tell=(told if told is not None else []).append,
        **{**arguments, **changes},
    )


class InlineEngine(StubEngine):
    """Runs any functions at once in this process."""

    def submit(self, function, *arguments):
        future = Future()
        future.set_result(function(*arguments))
        return future
