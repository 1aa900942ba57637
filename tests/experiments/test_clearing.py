"""Shares and claims of made-up tables."""

import types

from drake_srg.experiments.clearing import SCENES, Case, judge, shares, trial_columns


def table(total=6, cleared=5, picks=8, held=4, outcome="too_wide"):
    things = {f"clutter_{i}": {"cleared": i < cleared} for i in range(total)}
    for thing in things.values():
        thing["outcome"] = "cleared" if thing["cleared"] else outcome
    return types.SimpleNamespace(
        success=True,
        failure=None,
        objects_total=total,
        objects_cleared=cleared,
        picks=picks,
        picks_held=held,
        picks_per_hour=600.0,
        sim_time_s=30.0,
        objects=things,
    )


def rows(*tables):
    scene = next(iter(SCENES))
    runs = {Case(scene, i): metrics for i, metrics in enumerate(tables)}
    return {row.quantity: row for row in judge(runs)}


def test_shares_count_all_tables():
    found = shares([table(), table(cleared=6, picks=2, held=2)])
    assert (found["objects in the bin"].count, found["objects in the bin"].total) == (
        *(11, 12),
    )
    assert found["picks held"].value == 0.6
    low, high = found["picks held"].bounds
    assert low < 0.6 < high


def test_reasons_are_counted():
    assert rows(table(), table())["too_wide"].measured == 2


def test_a_claim_too_many_fails():
    claim = "claimed, not in the bin"
    assert rows(table())[claim].passed
    assert not rows(table(), table(cleared=2, held=4))[claim].passed


def test_a_line_for_each_table():
    scene = next(iter(SCENES))
    columns = trial_columns({Case(scene, 0): table(), Case(scene, 1): table()})
    assert {len(column) for column in columns.values()} == {2}
