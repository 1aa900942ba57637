"""Runs on hardware: what is refused, and what is left when a robot dies."""

import json
import subprocess
import sys

import numpy as np
import pytest
from bridges.ros2.peers import free_domain
from helpers import NEEDS_DDS
from rosbags.rosbag2 import Reader

from drake_srg.cli.main import main
from drake_srg.cli.process import TASK_FAILED
from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.safety_states import STATES, SafetyState
from drake_srg.hardware.config import HardwareConfig
from drake_srg.hardware.link import STAMP
from drake_srg.hardware.loop import ControlLoop
from drake_srg.hardware.opening import Hardware
from drake_srg.hardware.run import check_servo
from drake_srg.recording.log import read_log
from drake_srg.scenario import load_scenario
from drake_srg.types import Mode

SERVED = "kitchen_fast"
SERVOED = load_scenario("kitchen_servoing")
# Slower than real time, so that a busy machine keeps up.
RATE = 0.05


@pytest.mark.parametrize(
    ("release", "start", "message"),
    [
        (5.0, {STAMP: np.zeros(1)}, "release: must be 0 with planner: !Servoing"),
        (0.0, {}, "planner: !Servoing needs an arm whose states have time stamps"),
    ],
)
def test_what_a_visual_servo_cannot_do_is_refused(release, start, message):
    hardware = Hardware([], {}, start)
    with pytest.raises(ScenarioError, match=message):
        check_servo(SERVOED, HardwareConfig(release=release), hardware)


def test_any_release_will_do_without_a_visual_servo():
    config = HardwareConfig(release=5.0)
    check_servo(load_scenario("kitchen"), config, Hardware([], {}, {}))


@pytest.fixture
def robot(tmp_path):
    """A served cell that stands for a robot, and the hardware file that reaches it."""
    domain = str(free_domain())
    file = tmp_path / "robot.yaml"
    file.write_text(
        "arm: !Ros2Arm {}\ngripper: !Ros2Gripper {}\n"
        "cameras: {ceiling: !Ros2Camera {}}\n"
        f"ros2: {{domain: {domain}}}\nrate: {RATE}\npatience: 120.0\n"
    )
    command = [sys.executable, "-m", "drake_srg", "serve", SERVED, "--no-record"]
    command += ["--ros2", "--domain", domain, "--rate", str(RATE)]
    command += ["--set", "arm.limits=null"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline().startswith(SERVED)
            yield process, file
        finally:
            process.kill()


@pytest.mark.slow
@NEEDS_DDS
def test_a_robot_that_dies_ends_the_run_in_a_stop_with_a_complete_recording(
    robot, tmp_path, monkeypatch, capsys
):
    process, file = robot
    advance, moving, died_at = ControlLoop.advance, [], []

    def advance_until_it_dies(loop, commands=None):
        goes_on = advance(loop, commands)
        if loop.status.mode is Mode.PRE_GRASP:
            moving.append(loop.time)
            if loop.time > moving[0] + 0.3 and not died_at:
                process.kill()
                died_at.append(loop.time)
        return goes_on

    monkeypatch.setattr(ControlLoop, "advance", advance_until_it_dies)
    out = tmp_path / "out"
    command = ["run", SERVED, "--hardware", str(file), "--out", str(out)]
    assert main(command) == TASK_FAILED
    assert "nothing arrives from the robot any more" in capsys.readouterr().out
    metrics = json.loads((out / "metrics.json").read_text())
    assert (metrics["success"], metrics["claimed"]) == (None, False)
    assert metrics["failure"] == "stopped"
    assert metrics["placement_error_m"] is None
    (stop,) = metrics["safety_stops"]
    assert stop["reason"] == "stale"
    log = read_log(out / "log.npz")
    rests = log["safety.state"][:, 0] == STATES.index(SafetyState.PROTECTIVE_STOP)
    sampling = load_scenario(SERVED).recording.period
    speed = np.abs(log["arm.state_measured"][:, 7:]).max(axis=1)
    assert speed[np.searchsorted(log["time"], died_at[0])] > 0.01
    assert log["time"][rests][0] < died_at[0] + 0.2 + sampling
    with Reader(out / "recording.mcap") as reader:
        assert reader.message_count > 0
        assert reader.duration * 1e-9 > died_at[0]
    assert (out / "timeline.png").stat().st_size > 0
