import pytest

from drake_srg.experiments.registry import quiet
from measure import localizer_thresholds
from measure.localizer_thresholds import Change, kind, make_result, settings
from measure.threshold_scenes import GROUPS, Group
from measure.thresholds import THRESHOLDS, Setting
from tools.measure.made_looks import (
    DOUBTED,
    GOOD,
    KITCHEN,
    MISSED,
    NEARER,
    OFF,
    UNSEEN,
)


def of(look, count=10):
    return {(look.group, seed): look for seed in range(count)}


def failed(used, tried):
    looks = {Setting(): of(used)}
    looks |= {Setting(THRESHOLDS[0], i): of(tried) for i in range(2)}
    return {row.quantity for row in make_result(looks).rows if not row.passed}


def test_good_values_pass():
    assert failed(GOOD, GOOD) == set()
    assert failed(GOOD, OFF) == set()


def test_another_value_that_loses_less_fails():
    assert any(q.startswith("scenes better") for q in failed(DOUBTED, GOOD))


def test_another_value_that_is_more_accurate_fails():
    assert failed(GOOD, NEARER) == {
        "error over that of the value in use, kitchen_varied; the least"
    }


@pytest.mark.parametrize(
    ("used", "quantities"),
    [
        (OFF, {"share seen near enough", "certain, but not near"}),
        (UNSEEN, {"share seen near enough"}),
        (MISSED, {"obstacles missed", "obstacles invented"}),
    ],
)
def test_values_in_use_with_losses_fail(used, quantities):
    assert quantities <= failed(used, used)


def test_errors_are_compared_in_scenes_that_are_near_with_both_values():
    seen = {(KITCHEN, 0): NEARER, (KITCHEN, 1): OFF, (KITCHEN, 2): NEARER}
    used = {(KITCHEN, 0): GOOD, (KITCHEN, 1): GOOD, (KITCHEN, 2): UNSEEN}
    change = Change.of(seen, used, [kind(KITCHEN), "none"])
    assert change == Change(better=1, worse=1, errors=(pytest.approx(0.5), 1.0))


def test_a_gain_in_one_place_must_not_be_lost_in_another():
    assert Change(better=1, worse=1, errors=(0.5, 1.1)).harmless
    assert not Change(better=1, worse=1, errors=(0.5, 1.2)).harmless
    assert not Change(better=1, worse=2, errors=(0.5, 1.0)).harmless


def tried(group, only=""):
    first, *others = settings(group, only)
    assert first == Setting()
    return [setting.threshold.path for setting in others]


def test_both_values_of_all_thresholds_are_tried():
    assert tried(KITCHEN) == [t.path for t in THRESHOLDS for _ in range(2)]


def test_only_thresholds_of_obstacles_are_tried_in_more_scenes():
    (more,) = (group for group in GROUPS if group.step)
    assert tried(more) == [t for t in tried(KITCHEN) if t.startswith("obstacles.")]
    assert tried(more, only="fit.") == []


def test_single_thresholds_can_be_tried():
    assert tried(KITCHEN, only="fit.apart") == ["fit.apart"] * 2


@pytest.mark.slow
def test_it_runs(monkeypatch):
    group = Group("assistive_arm_varied", "leaning", range(1))
    monkeypatch.setattr(localizer_thresholds, "GROUPS", (group,))
    result = localizer_thresholds.run(quiet, only="candidates.least")
    (table,) = result.tables.values()
    assert table["threshold"] == [
        "all",
        *["candidates.least_area"] * 2,
        *["candidates.least_whole_area"] * 2,
        *["candidates.least_behind"] * 2,
    ]
    values = ["0.04", "0.16", "0.25", "1", "0.15", "0.6"]
    assert table["value"] == ["in use", *values]
    assert table["scenes"] == [1] * 7
    assert result.figure.axes
