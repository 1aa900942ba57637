import numpy as np
import pytest

from drake_srg.experiments.registry import quiet
from measure.time_parameterization import Comparison, judge, run


def made(ratio, wall_ratio, grid=31):
    return Comparison(grid, np.array([ratio, 1.0]), np.array([wall_ratio, 1.0]))


@pytest.mark.parametrize(
    ("results", "failed"),
    [
        ([made(1.0, 0.5), made(1.04, 0.5)], set()),
        ([made(1.0, 0.5), made(1.06, 0.5)], {"duration, largest ratio"}),
        (
            [made(1.0, 0.5), made(np.nan, 0.5)],
            {f"duration, {n} ratio" for n in ("smallest", "median", "largest")},
        ),
        ([made(1.0, 0.5), made(1.0, 1.1, grid=65)], {"wall time, median ratio"}),
    ],
)
def test_durations_and_wall_times_are_judged_as_ratios(results, failed):
    assert {row.quantity for row in judge(results) if not row.passed} == failed


@pytest.mark.slow
def test_it_compares_both_on_every_path():
    result = run(quiet, paths=4)
    durations = [row for row in result.rows if row.quantity.startswith("duration")]
    assert all(row.passed for row in durations)
    (table,) = result.tables.values()
    assert {len(column) for column in table.values()} == {4}
