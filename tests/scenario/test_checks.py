"""What is wrong in scenarios that are changed in Python; files are in test_scenario."""

import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.planning.script.scripted import ScriptStep
from drake_srg.scenario import load_scenario
from drake_srg.scenario.checks import check_scenario


def test_every_loaded_scenario_passes_again():
    for name in ("kitchen", "gripper_bench"):
        check_scenario(load_scenario(name), name)


def test_a_change_in_python_can_be_checked():
    bench = load_scenario("gripper_bench")
    bench.script.append(ScriptStep(arm=[0.0]))
    message = rf"^mine: script\[{len(bench.script) - 1}\]\.arm: .* the arm \(3\), got 1"
    with pytest.raises(ScenarioError, match=message):
        check_scenario(bench, "mine")
