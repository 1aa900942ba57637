import dataclasses as dc

import pytest

from drake_srg.sweeps.info import (
    SweepInfo,
    current_versions,
    difference,
    dump_tree,
    read_sweep,
    version_difference,
)

TREE = {"object": {"mass": 0.3, "position": [0.1, 0.2]}, "seed": None}
INFO = SweepInfo(
    "kitchen", 7, 10, "none", ["a=1"], dump_tree(TREE), {"drake": "1"}, jobs=2
)


def changed(**changes):
    return dc.replace(INFO, **changes)


def test_a_sweep_is_read_as_it_was_written(tmp_path):
    INFO.write(tmp_path)
    assert read_sweep(tmp_path) == INFO


@pytest.mark.parametrize(
    ("new", "expected"),
    [
        (INFO, ""),
        (changed(trials=11, engine="ray", jobs=None, started="now"), ""),
        (changed(trials=9), "trials: was 10, is 9"),
        (changed(seed=8), "seed: was 7, is 8"),
        (changed(record="all"), "record: was none, is all"),
        (changed(versions={"drake": "2"}), "drake: was 1, is 2"),
        (
            changed(tree=dump_tree(TREE | {"object": {"mass": 0.4}})),
            "object.mass: was 0.3, is 0.4",
        ),
        (
            changed(tree=dump_tree(TREE | {"object": {"mass": 0.3, "position": []}})),
            "object.position.0: was 0.1, is missing",
        ),
    ],
)
def test_the_first_difference_is_named(new, expected):
    assert difference(INFO, new) == expected


@pytest.mark.parametrize(
    ("name", "decisive"),
    [
        ("drake", True),
        ("drake_srg", True),
        ("drake_srg_sources", True),
        ("python", False),
        ("processor", False),
    ],
)
def test_only_versions_that_can_change_rows_count(name, decisive):
    here = current_versions()
    there = {**here, name: "other"}
    expected = (name, "other", here[name]) if decisive else None
    assert version_difference(there, here) == expected


def test_equal_trees_give_equal_text():
    assert dump_tree(TREE) == dump_tree(dict(reversed(TREE.items())))
