import json
import sys

import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.simulation.peers import Peer, measure_robosuite

TIMES = {
    "version": "1.5.2",
    "success": True,
    "simulated": 8.25,
    "total": 0.8,
    "lift_steps_per_s": 260.4,
}


def interpreter(path, body):
    """Make an executable that stands in for the other environment's Python."""
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)
    return path


def test_the_last_line_of_the_other_python_holds_its_times(tmp_path):
    text = json.dumps(TIMES)
    python = interpreter(tmp_path / "python", f"echo warnings; echo '{text}'")
    peer = measure_robosuite(python)
    assert peer == Peer(**TIMES)
    assert peer.lines() == [
        "robosuite 1.5.2, IIWA",
        "PickPlaceCan          success, 8.25 s simulated, 0.80 s wall clock",
        "Lift                  260 control steps per s",
    ]


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("echo 'no module' >&2; exit 1", "no module"),
        ("exit 3", "exit code 3"),
        ("true", "list index"),
        ("echo '{}'", "missing"),
        ("echo words", "Expecting value"),
    ],
)
def test_an_unfit_python_is_bad_input(tmp_path, body, reason):
    python = interpreter(tmp_path / "python", body)
    with pytest.raises(ScenarioError, match=reason) as caught:
        measure_robosuite(python)
    assert str(caught.value).startswith(f"--peers {python}: must be")


def test_a_missing_python_is_bad_input(tmp_path):
    with pytest.raises(ScenarioError, match="No such file"):
        measure_robosuite(tmp_path / "python")


@pytest.mark.slow
def test_a_python_without_robosuite_is_bad_input():
    with pytest.raises(ScenarioError, match="No module named 'robosuite'"):
        measure_robosuite(sys.executable)
