import numpy as np
import pytest

from drake_srg.scenario import load_scenario
from measure import recording_cost as module
from measure.recording_cost import PARTS, SCENARIOS, Case, judge, ratios


def made_up(everything):
    seconds = {part: np.array([2.0, 4.0, 3.0]) for part in PARTS}
    seconds["everything"] = everything * seconds["unrecorded"]
    return dict.fromkeys(SCENARIOS, seconds)


@pytest.mark.parametrize(("everything", "passes"), [(2.9, True), (3.1, False)])
def test_the_cost_of_everything_is_judged(everything, passes):
    rows = [row for row in judge(made_up(everything)) if row.quantity == "everything"]
    assert len(rows) == len(SCENARIOS)
    assert all(row.passed == passes for row in rows)


def test_only_the_time_itself_depends_on_the_machine():
    clocks = {row.quantity: row.clock for row in judge(made_up(2.0))}
    assert clocks.pop("unrecorded") == "time"
    assert set(clocks.values()) == {""}


def test_ratios_are_of_the_same_seeds():
    cost = {"unrecorded": np.array([1.0, 10.0]), "everything": np.array([2.0, 30.0])}
    assert ratios(cost) == {"unrecorded": 1.0, "everything": pytest.approx(2.5)}


@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize("part", PARTS)
def test_each_part_makes_a_scenario_that_records_it(scenario, part):
    loaded = load_scenario(scenario, seed=0, overrides=PARTS[part] or ())
    assert bool(loaded.recording.bag_cameras) == (
        "no images" not in part and part != "numbers alone"
    )
    assert (loaded.recording.video_camera == "") == (
        part in ("numbers alone", "images, no video")
    )


@pytest.mark.slow
def test_a_trial_takes_processor_time(monkeypatch):
    monkeypatch.setattr(
        module, "PARTS", {"short": ("planner.time_budget=0.1", *PARTS["numbers alone"])}
    )
    assert module.processor_time(Case("kitchen_varied", "short", 0)) > 0.1
