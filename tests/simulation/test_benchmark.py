import itertools

import pytest

from drake_srg.scenario import list_scenarios, load_scenario
from drake_srg.simulation import Simulate
from drake_srg.simulation.benchmark import (
    Benchmark,
    benchmark_table,
    import_times,
    run_benchmark,
    scenarios_with_fast_variant,
)


def some_benchmark(total=4.0):
    return Benchmark(
        result="success",
        placement_error=[0.001, -0.0005, 0.0],
        simulated=8.0,
        total=total,
        plant=2.0,
        planning=0.5,
        rendering=0.25,
        setup=0.4,
    )


def test_our_systems_take_the_rest_of_the_time():
    benchmark = some_benchmark()
    assert benchmark.other == pytest.approx(1.25)
    rows = benchmark.rows()
    assert rows["speed"] == "2.00 x real time"
    assert rows["bare plant"] == "4.00 x real time"
    assert rows["speed : bare plant"] == "0.50"
    assert rows["placement error x, y"] == "1.00, -0.50 mm"
    assert rows["our systems"] == "1.25 s, 31%"
    assert rows["before and after"] == "0.40 s"


def test_the_table_has_one_column_per_scenario():
    table = benchmark_table(
        {"kitchen": some_benchmark(), "other": some_benchmark(total=8.0)}
    )
    first, *_ = table.splitlines()
    assert first.split() == ["kitchen", "other"]
    (speed,) = [line for line in table.splitlines() if line.startswith("speed  ")]
    assert " ".join(speed.split()) == "speed 2.00 x real time 1.00 x real time"


def test_each_scenario_is_followed_by_its_fast_variant():
    names = scenarios_with_fast_variant()
    assert names[names.index("kitchen") + 1] == "kitchen_fast"
    assert names[names.index("assistive_arm") + 1] == "assistive_arm_fast"
    assert all(name in list_scenarios() for name in names)
    assert len(names) % 2 == 0


# Looks for the can in vain and ends within a second of simulated time.
IN_VAIN = ["object.present=false"]
# Looks at the table, and ends before it plans a pick.
BRIEF_CLEARING = ["clutter.count=1", "planner.time_budget=1.0"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "overrides", "failure", "simulated"),
    [
        ("kitchen", IN_VAIN, "not_seen", 1.0),
        ("clear_table_fast", BRIEF_CLEARING, "time_budget", 1.5),
    ],
)
def test_a_benchmark_measures_every_part(
    name, overrides, failure, simulated, monkeypatch
):
    scenario = load_scenario(name, overrides=overrides)
    looks = Simulate(scenario).status.looks
    clock = itertools.count()  # ticks when it is read: whatever is timed takes 1 s
    monkeypatch.setattr("time.perf_counter", lambda: float(next(clock)))
    benchmark = run_benchmark(scenario)
    assert benchmark.result == failure
    assert benchmark.simulated == pytest.approx(simulated, abs=0.2)
    assert benchmark.plant == 1.0
    assert benchmark.rendering == looks > 0
    assert benchmark.planning == 0.0  # neither comes to plan anything
    assert benchmark.total >= 1.0
    assert benchmark.setup >= 1.0


@pytest.mark.slow
def test_imports_are_measured_in_processes_of_their_own(monkeypatch):
    clock = itertools.count()
    monkeypatch.setattr("time.perf_counter", lambda: float(next(clock)))
    times = import_times()
    assert list(times) == [
        "python without imports",
        "import drake_srg",
        "all imports of a run",
    ]
    assert set(times.values()) == {1.0}
