"""docs/own_diagram.md and its programs: they run, are short, and are typed.

The notebook `compose` runs `planner.py`: it shows mode, error and video, and
tests/test_notebooks.py compares them with what is saved.
"""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.planning import HandTarget
from drake_srg.recording import read_log
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeTaskPlanner

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "examples/own_diagram"
PAGE = (ROOT / "docs/own_diagram.md").read_text("utf-8")
PROGRAMS = ("hand", "wires", "systems", "camera", "planner", "elbow", "two_hands")


@pytest.fixture
def program(monkeypatch):
    """Return the function that imports a program."""
    monkeypatch.syspath_prepend(str(FOLDER))

    def load(name):
        module = __import__(name)
        for each in (*PROGRAMS, "own_world"):
            sys.modules.pop(each, None)
        return module

    return load


def test_the_page_shows_every_program_and_each_is_short():
    shown = re.findall(r"{literalinclude} \.\./examples/own_diagram/(\w+)\.py", PAGE)
    assert shown == ["own_world", *PROGRAMS]
    for path in FOLDER.glob("*.py"):
        assert len(path.read_text("utf-8").splitlines()) <= 90, path


@pytest.mark.slow
def test_the_programs_pass_a_strict_type_checker(tmp_path):
    reference = (ROOT / "docs/reference/index.md").read_text("utf-8")
    (lines,) = re.findall(r"```toml\n(.*?)```", reference, re.DOTALL)
    config = tmp_path / "pyproject.toml"
    config.write_text("[tool.mypy]\nstrict = true\n" + lines)
    command = [sys.executable, "-m", "mypy", "--config-file", str(config), "."]
    done = subprocess.run(
        command, cwd=FOLDER, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


def test_a_box_rests_where_it_was_put(program):
    AddBox = program("own_world").AddBox
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.002)
    X_WO = RigidTransform([0.1, 0.0, 0.05])
    box = AddBox(plant, "box", [0.05, 0.05, 0.1], X_WO, mass=0.3)
    AddBox(plant, "ground", [1.0, 1.0, 0.1], RigidTransform([0.0, 0.0, -0.05]))
    plant.Finalize()
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(1.0)
    context = plant.GetMyContextFromRoot(simulator.get_context())
    moved = X_WO.inverse() @ box.EvalPoseInWorld(context)
    # Its weight presses 50 MPa over 25 cm² in by less than a micrometre.
    assert np.linalg.norm(moved.translation()) < 1e-5
    assert np.linalg.norm(moved.rotation().ToAngleAxis().angle()) < 1e-4


@pytest.mark.slow
def test_a_hand_on_an_arm_of_ones_own_lifts_a_box(program, tmp_path):
    assert program("hand").main(tmp_path) == pytest.approx(0.2, abs=1e-3)
    assert read_log(tmp_path / "log.npz")["gripper.grasped"][-1, 0] == 1.0
    assert (tmp_path / "replay.html").exists()


@pytest.mark.slow
def test_wires_pull_as_far_as_their_motor_may(program, tmp_path):
    force = program("wires").main(tmp_path)
    # 0.3 of what the motor's full torque balances at rest, and what winding up adds.
    assert 40.0 < force < 120.0
    joints = read_log(tmp_path / "log.npz")["state_measured [rad, rad/s]"][:, :4]
    assert joints.max() > 0.5
    np.testing.assert_allclose(joints[-1], 0.0, atol=0.2)


@pytest.mark.slow
def test_systems_wired_by_hand_close_the_hand(program, tmp_path):
    q = program("systems").main(tmp_path)
    log = read_log(tmp_path / "log.npz")
    # At half of the way in, the fingers do not meet yet: nothing holds them back.
    np.testing.assert_allclose(q, log["targets [rad]"][-1], atol=1e-3)
    np.testing.assert_allclose(q, [1.5, 1.5, 0.0, 0.0], atol=1e-3)


@pytest.mark.slow
def test_a_camera_of_ones_own_shows_the_localizer_a_box(program):
    blob, X_WO = program("camera").main()
    error = X_WO.inverse() @ blob.X_WO
    assert np.linalg.norm(error.translation()) < 1e-3
    assert abs(RollPitchYaw(error.rotation()).yaw_angle()) < 0.02


@pytest.mark.slow
def test_a_condition_keeps_the_elbow_up(program):
    reach = program("elbow").reach
    scene = MakeTaskPlanner(load_scenario("kitchen")).scene
    target = HandTarget(np.array([0.5, 0.0, 0.3]))
    q_home = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.5, 0.0])
    q = reach(scene, target, q_home).q
    context = scene.plant.CreateDefaultContext()
    scene.plant.SetPositions(context, scene.positions(q))
    elbow = scene.plant.GetFrameByName("link_4").CalcPoseInWorld(context)
    assert elbow.translation()[2] >= 0.6 - 1e-5
    failure = reach(scene, target.shifted(np.array([0.35, 0.0, -0.25])), q_home)
    assert failure.message.startswith("elbow up (your own): cannot be met together")


@pytest.mark.slow
def test_two_hands_lift_a_bar_level(program, tmp_path):
    X_WO = program("two_hands").main(tmp_path)
    # Half of the bar's weight sinks a carriage's spring by 0.12 mm.
    assert X_WO.translation()[2] == pytest.approx(0.25, abs=1e-3)
    assert abs(RollPitchYaw(X_WO.rotation()).pitch_angle()) < 0.01
