import numpy as np
import pytest

from drake_srg.experiments.grasp_measures import (
    Trial,
    auc,
    auc_by_object,
    auc_error,
    judged,
)
from drake_srg.experiments.household import household_cases
from drake_srg.experiments.shaken_grasp import ShakenGrasp, from_json, to_json
from drake_srg.planning.grasps.grasp_measures import MEASURES, Body, Patch


def shaken(seed, force, survived, lifted=True):
    """A pinch by two pads of four points."""
    corners = np.array([(x, 0.0, z) for x in (-0.01, 0.01) for z in (-0.01, 0.01)])
    patches = [
        Patch(
            corners + np.array([0.0, 0.03 * side, 0.0]),
            np.tile([0.0, -side, 0.0], (4, 1)),
            np.full(4, force / 4),
            0.5,
            np.array([0.0, -side * force, 1.0]),
        )
        for side in (-1.0, 1.0)
    ]
    body = Body(0.3, np.zeros(3), 0.05)
    return ShakenGrasp(seed, lifted, survived, patches, body, 10.0, 0.001)


def trials():
    """Grasps that hold the better, the harder they press."""
    case = household_cases()[0]
    return [(Trial(case, k), shaken(k, 5.0 + k, survived=k >= 5)) for k in range(10)]


def rows_of(result):
    return {(row.name, row.quantity): row.measured for row in result.rows}


def test_a_measure_that_tells_has_an_auc_of_one():
    # Grasps that were not lifted do not count.
    other = (trials()[0][0], shaken(99, 99.0, False, lifted=False))
    rows = rows_of(judged([*trials(), other], failed=2))
    assert (rows["all", "shakes"], rows["all", "lifted"]) == (13, 10)
    for name in ("friction margin", "epsilon, forces", "resisted acceleration"):
        assert rows[name, "AUC"] == rows[name, "AUC, mean of objects"] == 1.0
    # These do not look at forces.
    assert rows["epsilon, patches", "AUC"] == 0.5
    assert {name for name, what in rows if what == "cost"} == set(MEASURES)


def test_a_grasp_survives_being_written():
    made = shaken(3, 7.0, True)
    again = from_json(to_json(made))
    assert (again.seed, again.survived, again.moved) == (3, True, 0.001)
    for measure in MEASURES.values():
        assert measure(again.patches, again.body) == measure(made.patches, made.body)


def test_one_kind_of_outcome_ranks_nothing():
    value, held = np.arange(4.0), np.ones(4, bool)
    assert np.isnan(auc(value, held))
    assert np.isnan(auc_by_object(value, held, np.array(["a"] * 4)))


def test_the_error_of_an_auc():
    # Their equation 1, worked by hand for 51 and 58 cases and an area of 0.893.
    held = np.arange(109) < 51
    assert auc_error(0.893, held) == pytest.approx(0.0325, abs=1e-4)
    assert np.isnan(auc_error(0.9, np.ones(3, bool)))


@pytest.mark.parametrize("flip", [False, True])
def test_auc_counts_pairs(flip):
    value, held = np.array([1.0, 2.0, 3.0]), np.array([False, True, True])
    assert auc(-value if flip else value, held) == (0.0 if flip else 1.0)
