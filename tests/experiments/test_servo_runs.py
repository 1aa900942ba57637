import pytest

from drake_srg.experiments.servo_runs import Wire, run_over_servos


@pytest.mark.slow
def test_a_planner_at_a_bus_reports_what_ends_its_run():
    run = run_over_servos("assistive_arm", 0, Wire(), ["planner.time_budget=0.3"])
    assert not run.claimed
    assert not run.placed
    assert run.stopped == ""
    assert run.told == []


@pytest.mark.slow
def test_without_any_measurement_the_arm_is_stopped_at_once():
    wire = Wire(loss=1.0)
    run = run_over_servos("assistive_arm", 0, wire, ["planner.time_budget=0.3"])
    assert run.stopped == "measured_not_finite"
    assert len(run.told) == 1
