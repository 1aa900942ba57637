import numpy as np
import pytest

from drake_srg.experiments import sweep_throughput as module
from drake_srg.experiments.registry import quiet
from drake_srg.experiments.sweep_throughput import Sweep, extrapolate, judge


def made(jobs, wall, memory):
    return Sweep(jobs, wall, {f"w{i}": np.array(memory) for i in range(jobs)})


@pytest.mark.parametrize(
    ("walls", "memory", "failed"),
    [
        ((100.0, 51.0), [400.0] * 50, []),
        ((100.0, 54.0), [400.0] * 50, ["throughput"]),
        ((100.0, 51.0), [400.0] * 49 + [601.0], ["largest memory of a worker"]),
        ((100.0, 51.0), 400.0 + 0.3 * np.arange(50), ["after 1000 trials"]),
    ],
)
def test_what_is_asked_is_judged(walls, memory, failed):
    one, two = (
        made(jobs, wall, memory) for jobs, wall in zip((1, 2), walls, strict=True)
    )
    rows = judge([one, two])
    quantities = {row.quantity for row in rows if not row.passed}
    assert set(failed) <= quantities
    if not failed:
        assert not quantities


def test_memory_that_fills_at_first_and_then_stays_is_flat():
    memory = np.minimum(300.0 + 10.0 * np.arange(100), 400.0)
    assert extrapolate(memory) == pytest.approx(400.0)


def test_the_experiment_has_rows_a_table_and_a_figure(monkeypatch):
    monkeypatch.setattr(
        module, "measure", lambda jobs, trials: made(jobs, 100.0 / jobs, [400.0] * 30)
    )
    result = module.run(quiet)
    assert result.passed
    table = result.tables["memory"]
    assert {len(values) for values in table.values()} == {90}
