import pytest

from drake_srg.scenario import list_scenarios, load_scenario
from drake_srg.simulation.bench import (
    Bench,
    bench_table,
    run_bench,
    scenarios_with_a_twin,
)


def some_bench(total=4.0):
    return Bench(
        result="success",
        placement_error=[0.001, -0.0005, 0.0],
        simulated=8.0,
        total=total,
        plant=2.0,
        planning=0.5,
        rendering=0.25,
    )


def test_the_rest_is_what_our_systems_take():
    bench = some_bench()
    assert bench.other == pytest.approx(1.25)
    rows = bench.rows()
    assert rows["speed"] == "2.00 x real time"
    assert rows["bare plant"] == "4.00 x real time"
    assert rows["speed : bare plant"] == "0.50"
    assert rows["placement error x, y"] == "1.00, -0.50 mm"
    assert rows["our systems"] == "1.25 s, 31%"


def test_a_table_has_a_column_a_scenario():
    table = bench_table({"kitchen": some_bench(), "other": some_bench(total=8.0)})
    first, *_ = table.splitlines()
    assert first.split() == ["kitchen", "other"]
    (speed,) = [line for line in table.splitlines() if line.startswith("speed  ")]
    assert " ".join(speed.split()) == "speed 2.00 x real time 1.00 x real time"


def test_twins_stand_side_by_side():
    names = scenarios_with_a_twin()
    assert names[names.index("kitchen") + 1] == "kitchen_fast"
    assert names[names.index("assistive_arm") + 1] == "assistive_arm_fast"
    assert all(name in list_scenarios() for name in names)
    assert len(names) % 2 == 0


@pytest.fixture(scope="module")
def bench():
    # Ends within a second of simulated time, after looking for the can in vain.
    return run_bench(load_scenario("kitchen", overrides=["object.present=false"]))


def test_a_bench_measures_every_part(bench):
    assert bench.simulated == pytest.approx(1.0, abs=0.2)
    assert bench.planning == 0.0  # there was nothing to plan
    assert bench.plant > 0.0
    assert bench.rendering > 0.0
    assert bench.total > bench.plant
