"""docs/safety.md: its scenario loads, its table is complete."""

import re
from pathlib import Path

from drake_srg.common.safety_states import SafetyState, StopReason
from drake_srg.scenario import load_scenario

PAGE = (Path(__file__).parents[3] / "docs" / "safety.md").read_text(encoding="utf-8")


def blocks(kind):
    return re.findall(rf"```{kind}\n(.*?)```", PAGE, re.DOTALL)


def test_the_profile_loads(tmp_path):
    (text,) = blocks("yaml")
    path = tmp_path / "careful.yaml"
    path.write_text(text)
    force = load_scenario(path, seed=0).safety.force
    assert force.profile[force.regions[0]].quasi_static == 50.0


def test_every_state_and_reason_is_explained():
    for name in [*SafetyState, *StopReason]:
        assert f"`{name.value}`" in PAGE or name is StopReason.NONE
