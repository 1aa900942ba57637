import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform

from drake_srg.experiments.registry import quiet
from drake_srg.experiments.varied_scenes import Obstacles, Scene
from drake_srg.types import Cylinder
from measure import localizer_thresholds
from measure.localizer_thresholds import (
    GROUPS,
    Change,
    Group,
    Look,
    kind,
    lean,
    make_result,
    settings,
)
from measure.thresholds import THRESHOLDS, Setting

KITCHEN = GROUPS[0]
CLEAN = Obstacles(missed=0, invented=0, errors=())
GOOD = Look(KITCHEN, Scene(1e-3, True), CLEAN, 0.1)
UNSEEN = dc.replace(GOOD, scene=Scene(np.nan, False, np.nan))
OFF = dc.replace(GOOD, scene=Scene(5e-3, True))
DOUBTED = dc.replace(GOOD, scene=Scene(1e-3, False))
TURNED = dc.replace(GOOD, scene=Scene(1e-3, True, np.deg2rad(6.0)))
MISSED = dc.replace(GOOD, obstacles=Obstacles(2, 1, ()))
NEARER = dc.replace(GOOD, scene=Scene(0.5e-3, True))


def of(look, count=10):
    return {(look.group, seed): look for seed in range(count)}


def failed(used, tried):
    looks = {Setting(): of(used)}
    looks |= {Setting(THRESHOLDS[0], i): of(tried) for i in range(2)}
    return {row.quantity for row in make_result(looks).rows if not row.passed}


@pytest.mark.parametrize(
    ("look", "loss"),
    [(GOOD, 0), (DOUBTED, 1), (UNSEEN, 1), (OFF, 2), (TURNED, 2), (MISSED, 3)],
)
def test_false_certainty_counts_twice(look, loss):
    assert look.loss == loss


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


@given(st.integers(0, 1000))
def test_a_leaning_cylinder_touches_the_table_or_hangs(seed):
    cylinder = Cylinder(0.012, 0.05)
    X_WO = lean(RigidTransform([0.1, 0.2, 0.025]), cylinder, seed)
    axis, p = X_WO.rotation().matrix()[:, 2], X_WO.translation()
    assert p[:2] == pytest.approx([0.1, 0.2])
    assert axis[2] >= 0.0
    lowest = p[2] - 0.025 * axis[2] - 0.012 * np.hypot(axis[0], axis[1])
    if seed % 2:
        assert 0.0 <= lowest <= 0.1
    else:
        assert lowest == pytest.approx(0.0, abs=1e-12)


def test_it_runs(monkeypatch):
    group = Group("assistive_arm_varied", "leaning", range(1))
    monkeypatch.setattr(localizer_thresholds, "GROUPS", (group,))
    result = localizer_thresholds.run(quiet, only="candidates.least")
    (table,) = result.tables.values()
    assert table["threshold"] == [
        "all",
        *["candidates.least_area"] * 2,
        *["candidates.least_behind"] * 2,
    ]
    assert table["value"] == ["in use", "0.04", "0.16", "0.15", "0.6"]
    assert table["scenes"] == [1] * 5
    assert result.figure.axes
