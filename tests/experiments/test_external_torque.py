import numpy as np
import pytest

from drake_srg.experiments import external_torque as module
from drake_srg.experiments.external_torque import CELLS, Case, feel, judge, limits
from drake_srg.experiments.registry import quiet
from drake_srg.scenario import load_scenario

STOPS = {cell: limits(cell) for cell in CELLS}


@pytest.mark.parametrize(("share", "passes"), [(0.49, True), (0.51, False)])
def test_more_than_half_of_a_limit_fails(share, passes):
    felt = {
        name: share * STOPS[cell] for cell, names in CELLS.items() for name in names
    }
    assert all(row.passed == passes for row in judge(felt, STOPS))


@pytest.mark.parametrize("cell", CELLS)
def test_both_physics_have_the_same_limits(cell):
    for name in CELLS[cell]:
        stop = load_scenario(name, seed=0).planner.max_external_torque
        np.testing.assert_array_equal(stop, STOPS[cell])


@pytest.mark.slow
def test_an_arm_feels_the_weight_of_its_object():
    torque = feel(Case("assistive_arm_varied", 0))
    shape = load_scenario("assistive_arm_varied", seed=0).objects["cylinder"]
    # At least the weight times a lever of 0.1 m, on shoulder or elbow.
    assert (
        0.1 * 9.81 * shape.mass
        < np.max(torque)
        < 0.5 * np.max(STOPS["assistive_arm_varied"])
    )


@pytest.mark.slow
def test_every_joint_is_judged_in_every_scenario(monkeypatch):
    def made_up(case):
        (cell,) = (cell for cell, names in CELLS.items() if case.scenario in names)
        return 0.01 * (case.seed % 10 + 1) * STOPS[cell]

    monkeypatch.setattr(module, "feel", made_up)
    result = module.run(quiet)
    assert result.passed
    tables = module.run(quiet, seeds=2).tables
    assert tables["kitchen_varied"]["seed"] == [0, 1]
    assert tables["assistive_arm_varied"]["seed"] == [0, 1, 800264]
    assert len(result.rows) == 2 * (7 + 5)
    row = next(row for row in result.rows if row.name == "kitchen_varied")
    assert row.measured == pytest.approx(0.1 * STOPS["kitchen_varied"][0])
