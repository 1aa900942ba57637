import collections
import threading
import time
from concurrent.futures import BrokenExecutor, Future

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.sweeps.sweep import TRIES, dispatch
from drake_srg.sweeps.trial import TrialResult, empty_row

from . import stub


def run(engine, trials, function=stub.trial):
    def submit(trial):
        return engine.submit(function, {}, "", 0, trial, "none")

    def lost(trial, reason):
        return TrialResult(empty_row(0, trial, reason))

    return [result.row for result in dispatch(engine, trials, submit, lost)]


# More deaths than these in a row would mean that the workers are broken.
@given(st.dictionaries(st.integers(0, 9), st.integers(0, TRIES - 1), max_size=4))
def test_each_trial_gives_one_result_though_workers_die_now_and_then(dying):
    engine = stub.StubEngine(dying)
    rows = run(engine, range(10))
    assert sorted(row["trial"] for row in rows) == list(range(10))
    assert not any(row["failure"] == "error" for row in rows)
    tries = collections.Counter(engine.given)
    assert all(tries[trial] == 1 + dying.get(trial, 0) for trial in range(10))


def test_a_trial_that_keeps_killing_its_workers_ends_in_an_error():
    engine = stub.StubEngine({4: 100})
    rows = {row["trial"]: row for row in run(engine, range(6))}
    assert sorted(rows) == list(range(6))
    assert rows[4]["failure"] == "error"
    assert f"its worker died {TRIES} times: SIGKILL(-9)" in rows[4]["message"]
    assert engine.given == [0, 1, 2, 3, 4, 5, 4, 4, 4]  # again after all others


class PendingEngine(stub.StubEngine):
    """A pool whose trials end on command."""

    def __init__(self, slots):
        super().__init__()
        self.size, self.futures = slots, []

    def slots(self):
        return self.size

    def submit(self, *arguments):
        future = Future()
        self.futures.append(future)
        self.given.append(arguments[-2])  # last, because `await_given` looks at it
        return future

    def await_given(self, number):
        for _ in range(1000):
            if len(self.given) == number:
                return
            time.sleep(0.01)
        raise AssertionError(f"{self.given} were submitted, not {number}")

    def end(self, error=None):
        futures, self.futures = self.futures, []
        for trial, future in zip(self.given[-len(futures) :], futures, strict=True):
            if error is None:
                future.set_result(stub.trial({}, "", 0, trial, "none"))
            else:
                future.set_exception(error)


DEAD = BrokenExecutor("SIGKILL(-9)")


def drive(engine, trials, ends):
    """Run trials, and end all that run whenever so many were given; return the rows."""
    rows = []
    thread = threading.Thread(
        target=lambda: rows.extend(run(engine, trials)), daemon=True
    )
    thread.start()
    for number, error in ends.items():
        engine.await_given(number)
        engine.end(error)
    thread.join(timeout=10.0)
    return rows


def test_trials_that_died_together_run_again_together_and_then_alone():
    ends = {4: DEAD, 8: DEAD, **dict.fromkeys(range(9, 13))}
    rows = drive(PendingEngine(4), range(4), ends)
    assert sorted(row["trial"] for row in rows) == [0, 1, 2, 3]


def test_a_trial_that_died_with_another_twice_may_still_die_once_alone():
    ends = {2: DEAD, 4: DEAD, 5: DEAD, 6: None, 7: DEAD, 8: None}
    rows = drive(PendingEngine(2), range(2), ends)
    assert {row["trial"]: row["failure"] for row in rows} == {0: None, 1: "dropped"}


def test_deaths_without_any_result_end_the_sweep():
    engine = stub.StubEngine(dict.fromkeys(range(100), 100))
    with pytest.raises(
        ScenarioError, match="workers keep dying, 10 times without a result"
    ):
        run(engine, range(100))


def test_an_exception_of_a_trial_is_raised():
    def broken(*_):
        raise ImportError("no av")

    with pytest.raises(ImportError, match="no av"):
        run(stub.StubEngine(), range(3), broken)


def test_no_more_trials_are_submitted_than_run_at_a_time():
    engine = stub.StubEngine()
    results = dispatch(
        engine,
        range(10),
        lambda trial: engine.submit(stub.trial, {}, "", 0, trial, "none"),
        lambda *_: None,
    )
    for count in range(1, 9):
        next(results)
        assert len(engine.given) <= count + engine.slots()
