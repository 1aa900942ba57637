import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.experiments.trials import (
    LIFTED,
    PLACED,
    bounds,
    line,
    outcomes,
    quantile_rows,
    share_rows,
)
from experiments.made_cycles import cycle


def made(lifted, placed):
    return [
        cycle(grasp_lifted=a, success=b) for a, b in zip(lifted, placed, strict=True)
    ]


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=30))
def test_shares_lie_within_their_intervals(trials):
    cycles = made(*zip(*trials, strict=True))
    rows = {row.quantity: row.measured for row in share_rows("case", cycles)}
    for k, what in enumerate((LIFTED, PLACED)):
        share = np.mean([trial[k] for trial in trials])
        assert rows[f"{what}, share"] == pytest.approx(share)
        low, high = rows[f"{what}, at least"], rows[f"{what}, at most"]
        assert (low, high) == bounds(cycles, what)
        assert 0.0 <= low <= share <= high <= 1.0


def test_a_grasp_that_was_never_tried_is_no_lift():
    assert outcomes(made([None, True], [False, True]))[LIFTED].tolist() == [False, True]


def test_quantiles_need_values():
    assert quantile_rows("case", "error", np.array([]), "mm") == []
    rows = quantile_rows("case", "error", np.arange(101.0), "mm")
    assert [row.measured for row in rows] == [50.0, 5.0, 95.0]


def test_a_line_has_numbers_where_a_figure_is_missing():
    entries = line(cycle(success=False, placement_error_m=None, smoothness=None))
    assert entries["placed"] == 0
    assert np.isnan([entries["placement error x [m]"], entries["smoothness"]]).all()
