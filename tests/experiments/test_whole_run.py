"""Tests of `drake_srg.experiments.whole_run`."""

from types import SimpleNamespace

import pytest

from drake_srg.experiments import whole_run
from drake_srg.experiments.whole_run import simulate_whole
from drake_srg.simulation.simulate import STOPPED_BY_USER
from drake_srg.types import PlannerStatus


def _ends_with(monkeypatch, message):
    result = SimpleNamespace(status=PlannerStatus(message=message))
    calls = []
    monkeypatch.setattr(
        whole_run, "Simulate", lambda *a, **k: (calls.append((a, k)), result)[1]
    )
    return result, calls


def test_a_whole_run_is_the_result(monkeypatch):
    result, calls = _ends_with(monkeypatch, "")
    assert simulate_whole("scenario", name="cell") is result
    assert calls == [(("scenario",), {"name": "cell"})]


def test_an_interrupted_run_ends_the_experiment(monkeypatch):
    _ends_with(monkeypatch, STOPPED_BY_USER)
    with pytest.raises(KeyboardInterrupt):
        simulate_whole("scenario")
