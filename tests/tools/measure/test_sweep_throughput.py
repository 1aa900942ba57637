import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.cli.main import main
from drake_srg.experiments.registry import quiet
from measure import sweep_throughput as module
from measure.sweep_throughput import Sweep, growth, judge


def made(jobs, wall, memory):
    return Sweep(jobs, wall, {f"w{i}": np.array(memory) for i in range(jobs)})


@pytest.mark.parametrize(
    ("walls", "memory", "failed"),
    [
        ((100.0, 51.0), [400.0] * 50, []),
        ((100.0, 54.0), [400.0] * 50, ["throughput"]),
        ((100.0, 51.0), [400.0] * 49 + [601.0], ["largest memory of a worker"]),
        ((100.0, 51.0), 400.0 + 0.3 * np.arange(50), ["growth a trial"]),
    ],
)
def test_speed_and_memory_are_judged(walls, memory, failed):
    one, two = (
        made(jobs, wall, memory) for jobs, wall in zip((1, 2), walls, strict=True)
    )
    rows = judge([one, two])
    quantities = {row.quantity for row in rows if not row.passed}
    assert set(failed) <= quantities
    if not failed:
        assert not quantities


def test_memory_that_grows_at_first_and_then_stays_does_not_count_as_growth():
    memory = np.minimum(300.0 + 10.0 * np.arange(100), 400.0)
    assert growth(memory) == pytest.approx(0.0, abs=1e-9)


def test_growth_is_the_memory_that_each_trial_leaves_behind():
    memory = 400.0 + 1.2 * np.arange(100)
    assert growth(memory) == pytest.approx(1.2)


def test_only_the_wall_clock_depends_on_the_machine():
    rows = judge([made(j, 100.0 / j, [400.0] * 50) for j in (1, 2)])
    assert {row.quantity for row in rows if row.clock == "time"} == {"wall clock"}


@given(at=st.integers(1, 179), size=st.floats(-17.0, 17.0))
def test_the_spread_of_growth_covers_a_step_of_the_allocator(at, size):
    still, step = (410.0 + s * (np.arange(200) >= 20 + at) for s in (0.0, size))
    old, new = (
        judge([made(1, 100.0, memory), made(2, 51.0, [400.0] * 100)])
        for memory in (still, step)
    )
    for before, after in zip(old, new, strict=True):
        assert abs(after.measured - before.measured) <= before.spread


@given(at=st.integers(1, 179), size=st.floats(-17.0, 17.0))
def test_a_step_of_the_allocator_does_not_count_as_growth(at, size):
    one = made(1, 100.0, 410.0 + size * (np.arange(200) >= 20 + at))
    two = made(2, 51.0, [400.0] * 100)
    assert all(row.passed for row in judge([one, two]))


@pytest.fixture
def no_sweep(monkeypatch):
    """Replaces the sweeps by made-up ones."""
    monkeypatch.setattr(
        module, "measure", lambda jobs, trials: made(jobs, 100.0 / jobs, [400.0] * 30)
    )


def test_the_experiment_has_rows_a_table_and_a_figure(no_sweep):
    result = module.run(quiet)
    assert result.passed
    table = result.tables["memory"]
    assert {len(values) for values in table.values()} == {90}


@pytest.mark.slow
def test_it_runs_as_a_command_from_a_checkout(no_sweep, tmp_path, capsys):
    assert main(["experiment", "sweep_throughput", "--out", str(tmp_path)]) == 0
    assert "throughput" in capsys.readouterr().out
    assert (tmp_path / "sweep_throughput.png").is_file()
