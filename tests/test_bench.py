import pytest

from drake_srg.bench import Bench, run_bench
from drake_srg.scenario import load_scenario


def test_the_rest_is_what_our_systems_take():
    bench = Bench(simulated=8.0, total=4.0, plant=2.0, planning=0.5, rendering=0.25)
    assert bench.other == pytest.approx(1.25)
    table = bench.table()
    for words in ("2.00 x real time", "4.00 x real time", "ours runs at 0.50 of it"):
        assert words in table


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
