"""A can that comes on a belt is taken off it while it moves."""

import numpy as np
import pytest

from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.types import Mode

pytestmark = pytest.mark.slow


def test_the_can_is_taken_while_the_belt_moves_and_the_rest_stays_on_it():
    result = Simulate(load_scenario("conveyor"), record=True)
    metrics, log = result.metrics, result.log
    assert metrics.success, metrics.failure
    assert metrics.attempts == 1
    closes = log["mode"] == list(Mode).index(Mode.CLOSE)
    time, y = log["time"][closes], log["object_pose.soup_can"][closes, 1]
    assert np.polyfit(time, y, 1)[0] == pytest.approx(0.1, rel=0.02)
    for name in ("blue_box", "green_can"):
        travel = log[f"object_pose.{name}"][-1, :3] - log[f"object_pose.{name}"][0, :3]
        assert travel == pytest.approx([0.0, 1.0, 0.0], abs=2e-3)


def test_a_can_that_never_comes_is_told():
    missing = ["object.present=false", "planner.search_time=1.0"]
    result = Simulate(load_scenario("conveyor", overrides=missing))
    assert result.metrics.failure == "not_seen"
    assert result.status.message == ("no soup_can in planner.window, or seen only once")
