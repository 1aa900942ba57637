"""examples/mujoco_grasp.py, with models as its docstring has them exported."""

import re
from pathlib import Path

import pytest

from drake_srg.cli.main import main

ROOT = Path(__file__).parents[2]


def test_the_hand_lifts_a_can_in_mujoco_and_holds_it(tmp_path, monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(ROOT / "examples"))
    monkeypatch.chdir(tmp_path)
    import mujoco_grasp

    (command,) = re.findall("drake-srg (.*)", mujoco_grasp.__doc__)
    assert main(command.split()) == 0
    _, grasped, lifted, held = mujoco_grasp.main("models/scene.xml")
    assert lifted == pytest.approx(grasped, abs=1e-3)
    assert held == pytest.approx(lifted, abs=5e-6 * 5.0)  # creeps less than 5 um/s
