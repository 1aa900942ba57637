"""The peg goes into its hole, and what is no hole for it is told by name."""

import numpy as np
import pytest

from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate

pytestmark = pytest.mark.slow

_FEW = ("planner.tries=1", "planner.time_budget=40")
NO_HOLE = "directives.hole.add_model.file=package://drake_srg/sdf/hole_none.sdf"
THICK = "objects.peg.shape.radius=0.01255"
PLUG = (
    "objects.plug={shape: !Cylinder {radius: 0.01, length: 0.01}, mass: 0.05,"
    " friction: 0.3, known: false, color: [0.2, 0.2, 0.2],"
    " pose: {translation: [0.55, -0.3, 0.0151]}}"
)


def run(*overrides):
    return Simulate(load_scenario("insert", overrides=overrides))


def test_the_peg_is_seated_and_released():
    result = run()
    assert result.metrics.success, result.metrics.failure
    assert np.abs(result.metrics.placement_error_m[2]) < 5e-4


@pytest.mark.parametrize(
    ("overrides", "failure"),
    [
        ([NO_HOLE], "no_hole"),
        ([THICK], "too_tight"),
        ([PLUG], "hole_blocked"),
    ],
)
def test_what_is_no_hole_for_the_peg_is_told(overrides, failure):
    assert run(*overrides, *_FEW).metrics.failure == failure
