import numpy as np
import pytest

from drake_srg.experiments import external_torque as module
from drake_srg.experiments.external_torque import CELLS, Case, feel, judge, limits
from drake_srg.experiments.registry import quiet
from drake_srg.scenario import load_scenario

STOPS = {cell: limits(cell) for cell in CELLS}


@pytest.mark.parametrize(("share", "passes"), [(0.49, True), (0.51, False)])
def test_half_of_what_stops_an_arm_is_too_much(share, passes):
    felt = {
        name: share * STOPS[cell] for cell, names in CELLS.items() for name in names
    }
    assert all(row.passed == passes for row in judge(felt, STOPS))


@pytest.mark.parametrize("cell", CELLS)
def test_both_physics_stop_at_the_same_torques(cell):
    for name in CELLS[cell]:
        stop = load_scenario(name, seed=0).planner.max_external_torque
        np.testing.assert_array_equal(stop, STOPS[cell])


def test_an_arm_feels_what_it_carries():
    torque = feel(Case("assistive_arm_varied", 0))
    shape = load_scenario("assistive_arm_varied", seed=0).objects["cylinder"]
    # Its weight at an arm's length of 0.1 m at least, on shoulder or elbow.
    assert (
        0.1 * 9.81 * shape.mass
        < np.max(torque)
        < 0.5 * np.max(STOPS["assistive_arm_varied"])
    )


def test_the_experiment_has_rows_tables_and_a_figure(monkeypatch):
    def made_up(case):
        (cell,) = (cell for cell, names in CELLS.items() if case.scenario in names)
        return 0.01 * (case.seed % 10 + 1) * STOPS[cell]

    monkeypatch.setattr(module, "feel", made_up)
    result = module.run(quiet)
    assert result.passed
    assert len(result.rows) == 2 * (7 + 5)
    row = next(row for row in result.rows if row.name == "kitchen_varied")
    assert row.measured == pytest.approx(0.1 * STOPS["kitchen_varied"][0])
