"""When things count as at rest, and how far they have moved since."""

import numpy as np
import pytest

from drake_srg.experiments import untouched
from drake_srg.experiments.registry import quiet
from drake_srg.experiments.untouched import AS_IS, SETTINGS, Stay, find_stay, judge

TIME = np.arange(0.0, 30.0, 0.02)
CORNERS = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])


def sliding(until, speed=0.01, then=0.0):
    """Return points of something that slides along x, then more slowly [m/s]."""
    x = speed * np.minimum(TIME, until) + then * np.maximum(TIME - until, 0.0)
    return CORNERS + x[:, np.newaxis, np.newaxis] * [1.0, 0.0, 0.0]


def test_all_must_have_been_slow_for_half_a_second():
    stay = find_stay(TIME, {"a": sliding(until=2.0), "b": sliding(until=3.0)})
    assert stay.rest == pytest.approx(3.5, abs=0.03)
    assert stay.moved == pytest.approx(0.0, abs=1e-12)


def test_creep_counts_from_then_on():
    points = {"a": sliding(until=2.0), "b": sliding(until=1.0, then=3e-4)}
    stay = find_stay(TIME, points)
    assert stay.thing == "b"
    assert stay.moved == pytest.approx(10.0 * 3e-4)  # in ten seconds


def test_a_turn_counts_at_the_point_that_it_moves_most():
    angle = 0.01 * np.maximum(TIME - 5.0, 0.0) / 25.0
    c, s, o = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    turned = np.stack([c, s, o], axis=-1)[:, np.newaxis] * [[0.0], [0.1]]
    stay = find_stay(TIME, {"a": turned})
    assert stay.rest == pytest.approx(0.5, abs=0.03)
    assert stay.moved == pytest.approx(0.1 * 0.01 * 5.5 / 25.0, rel=0.02)


@pytest.mark.parametrize("until", [20.0, np.inf])
def test_what_moves_for_too_long_is_not_at_rest(until):
    assert find_stay(TIME, {"a": sliding(until=until)}) == Stay(None)


def test_only_the_scenarios_as_they_are_are_judged():
    moved = [Stay(2.0, 0.002, "mug"), Stay(None)]
    rows = judge({("heap", settings): moved for settings in SETTINGS})
    motions = [row for row in rows if row.unit == "mm"]
    assert [row.passed for row in motions] == [
        name != f"heap, {AS_IS}" for name in (row.name for row in motions)
    ]
    assert all(row.measured == pytest.approx(2.0) for row in motions)
    counts = [row for row in rows if row.unit != "mm"]
    assert all(row.measured == 1 for row in counts)


def test_each_table_is_watched_with_all_settings(monkeypatch, tmp_path):
    seen = []

    def watch(table, settings, seed):
        seen.append((table, settings, seed))
        return Stay(2.0, 1e-4, "mug")

    monkeypatch.setattr(untouched, "watch", watch)
    kept = tmp_path / "kept.json"
    for _ in range(2):  # the second time from the file
        result = untouched.run(quiet, trials=2, seed=7, keep=str(kept))
        assert len(seen) == len(set(seen)) == 2 * 2 * len(SETTINGS)
        (table,) = result.tables.values()
        assert set(table["seed"]) == {7, 8}
        assert all(row.passed for row in result.rows)
