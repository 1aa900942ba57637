import numpy as np
import pytest

from drake_srg.importing.arm_check import FOLLOWS, OVERRUN, STILL, ArmCheck, check_arm
from drake_srg.parsing import models_path
from drake_srg.scenario import load_scenario

GOOD = {"moved": 0.0, "behind": 0.0, "overrun": 0.0, "strained": 1.0, "gravity": 0.5}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, None),
        ({"moved": 2 * STILL}, "does not hold still: 0.0040 rad or m (at most 0.002)"),
        ({"behind": 2 * FOLLOWS}, "does not follow"),
        ({"overrun": 2 * OVERRUN}, "overruns its limits"),
        ({"strained": 1.1}, "exerts 1.10 of its torque limits"),
        ({"gravity": 1.2}, "takes 1.20 of a torque limit"),
    ],
)
def test_each_problem_is_told(change, words):
    problems = ArmCheck(**GOOD | change).problems()
    assert len(problems) == (words is not None)
    assert words is None or words in problems[0]


@pytest.fixture
def iiwa_file():
    return models_path() / "sdf" / "iiwa14.sdf"


def test_our_own_arm_passes(iiwa_file):
    check, picture = check_arm(load_scenario("kitchen"), iiwa_file)
    assert check.problems() == []
    assert 0.05 < check.gravity < 1.0
    assert check.behind > 0.0
    assert picture.shape == (720, 1280, 3)
    assert np.ptp(picture) > 50


def test_an_arm_that_is_too_weak_is_told(iiwa_file):
    scenario = load_scenario("kitchen", overrides=["arm.motor_strength=0.1"])
    check, _ = check_arm(scenario, iiwa_file)
    assert "does not hold still" in " ".join(check.problems())
