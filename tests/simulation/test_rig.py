import functools
import textwrap

import av
import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ObjectConfig
from drake_srg.simulation import rig as rig_module
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Sphere
from experiments.data import household_objects

BALL = ObjectConfig(shape=Sphere(0.03), mass=0.1, friction=0.8)


def grasp():
    """Grasp a ball and lift it, in two seconds."""
    with Rig(bench_scenario(BALL, home=[0.0, 0.0, 0.2])) as rig:
        rig.advance(1.5, closure=0.8, force_limit=0.5)
        rig.move([0.0, 0.0, 0.3], 0.5)
        return rig, rig.log()


@pytest.fixture(scope="module")
def grasped():
    return grasp()


def test_a_rig_can_grasp_a_ball(grasped):
    rig, _ = grasped
    assert rig.time == pytest.approx(2.0)
    assert rig.X_WO().translation()[2] == pytest.approx(0.13, abs=0.02)
    assert rig.X_GO().translation()[2] == pytest.approx(0.0, abs=1e-3)
    np.testing.assert_allclose(
        (rig.X_WG() @ rig.X_GO()).translation(), rig.X_WO("thing").translation()
    )
    forces = rig.contact_forces()
    assert set(forces) == {"gripper"}
    assert forces["gripper"] > 0.5 * 0.1 * 9.81


def test_the_log_has_a_row_per_period_and_an_array_per_port(grasped):
    rig, log = grasped
    np.testing.assert_allclose(log["time"], np.arange(201) * 0.01, atol=1e-9)
    shapes = {name: array.shape for name, array in log.items()}
    assert shapes["object_pose.thing"] == (201, 7)
    assert shapes["arm.state_measured"] == (201, 6)
    assert shapes["gripper.state_measured"] == (201, 8)
    assert shapes["gripper.closure_commanded"] == (201, 1)
    assert {"gripper.pwm", "gripper.proximity", "gripper.contact_force"} <= set(log)
    np.testing.assert_array_equal(log["arm.state_measured"][0, :3], [0.0, 0.0, 0.2])
    np.testing.assert_array_equal(
        log["gripper.state_measured"][-1], rig.measured("gripper.state_measured")
    )
    np.testing.assert_allclose(log["object_pose.thing"][0], [0.5, 0, 0.03, 1, 0, 0, 0])


def test_the_arm_follows_its_commands(grasped):
    _, log = grasped
    np.testing.assert_array_equal(log["gripper.force_limit"][:, 0], 0.5)
    q, command = log["arm.state_measured"][:, :3], log["arm.position_commanded"]
    assert command[-1, 2] == pytest.approx(0.3, abs=1e-6)
    # The servo's bandwidth is 100 rad/s: at 0.375 m/s, the arm lags by at most two
    # periods of 2 ms.
    assert np.max(np.abs(q - command)) < 0.375 * 0.004


@pytest.mark.slow
def test_the_same_calls_give_the_same_bits(grasped):
    _, log = grasped
    _, again = grasp()
    assert log.keys() == again.keys()
    for name, array in log.items():
        assert array.tobytes() == again[name].tobytes(), name


def test_commands_can_be_functions_of_time():
    with Rig(bench_scenario(BALL, home=[0.0, 0.0, 0.5]), log_period=0.02) as rig:
        rig.advance(0.1)
        rig.advance(0.1, closure=lambda t: 5.0 * t, arm=lambda t: [t / 10, 0.0, 0.5])
        log = rig.log()
    closure = log["gripper.closure_commanded"][:, 0]
    # A row holds the commands that led to it; the last ones are one period old.
    ramp = np.clip(5.0 * (log["time"] - 0.1 - 0.002), 0.0, 1.0)
    np.testing.assert_allclose(closure, ramp, atol=1e-9)
    assert rig.commanded("arm.position_commanded")[0] == pytest.approx(0.0098)


def test_a_command_is_nan_before_it_is_first_set():
    with Rig(bench_scenario(BALL)) as rig:
        rig.advance(0.02)
        rig.advance(0.02, force_limit=0.25)
        limit = rig.log()["gripper.force_limit"][:, 0]
    np.testing.assert_array_equal(limit, [np.nan, np.nan, np.nan, 0.25, 0.25])


def test_the_log_is_empty_before_the_first_step():
    assert Rig(bench_scenario(BALL)).log() == {}


@pytest.mark.slow
def test_bad_arguments_are_reported():
    rig = Rig(bench_scenario(BALL))
    with pytest.raises(ScenarioError, match="rig: the station has no input feet"):
        rig.fix("feet", 1.0)
    with pytest.raises(
        ScenarioError, match=r"position_commanded needs 3 numbers, got 1"
    ):
        rig.advance(0.1, arm=[0.0])
    with pytest.raises(ValueError, match="log_period must be a positive multiple"):
        Rig(bench_scenario(BALL), log_period=0.003)
    with pytest.raises(ValueError, match="log_period must be a positive multiple"):
        Rig(bench_scenario(BALL), log_period=0.0)
    with pytest.raises(ScenarioError, match=r"per actuated joint of the arm \(3\)"):
        Rig(bench_scenario(BALL, home=[0.0]))


def test_an_aborted_simulation_is_reported_with_the_time():
    rig = Rig(bench_scenario(BALL), name="mine")
    rig.advance(0.1)
    with pytest.raises(ScenarioError, match=r"mine: the simulation failed at t = 0\.1"):
        rig.advance(0.1, arm=[np.nan] * 3)


@pytest.mark.slow
def test_a_video_shows_the_run(tmp_path):
    overrides = ["cameras.overview.width=160", "cameras.overview.height=128"]
    path = tmp_path / "run.mp4"
    with Rig(bench_scenario(BALL, overrides=overrides), video=path) as rig:
        rig.advance(0.5)
    with av.open(str(path)) as container:
        frames = [f.to_ndarray(format="rgb24") for f in container.decode(video=0)]
    assert len(frames) == 4  # 8 Hz
    assert frames[0].shape == (128, 160, 3)
    assert frames[0].std() > 20.0


def test_an_image_shows_the_scene():
    overrides = ["cameras.overview.width=160", "cameras.overview.height=128"]
    with Rig(bench_scenario(BALL, overrides=overrides), images=True) as rig:
        image = rig.image("overview")
    assert image.shape == (128, 160, 3)
    assert image.std() > 20.0


def test_a_video_needs_a_camera(tmp_path):
    bench = bench_scenario(BALL, overrides=["recording.video_camera=''"])
    with pytest.raises(
        ScenarioError, match=r"recording\.video_camera: must name a camera"
    ):
        Rig(bench, video=tmp_path / "run.mp4")


@pytest.mark.slow
def test_a_rig_is_freed(leaked):
    rig = Rig(bench_scenario(BALL))
    rig.advance(0.02)
    assert leaked()
    del rig
    assert leaked() == []


@pytest.mark.slow
def test_the_example_of_the_docstring_runs():
    example = textwrap.dedent(rig_module.__doc__.partition("::\n\n")[2].rstrip())
    fast = functools.partial(bench_scenario, scenario="gripper_bench_fast")
    names = {
        **vars(rig_module),
        "household_objects": household_objects,
        "bench_scenario": fast,
    }
    exec(example, names)
    assert names["held"]
    assert names["largest_force"] > 1.0
