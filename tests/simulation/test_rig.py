import textwrap

import av
import numpy as np
import pytest
from pydrake.math import RollPitchYaw

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments.data import household_objects
from drake_srg.objects.config import ObjectConfig
from drake_srg.simulation import rig as rig_module
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Sphere

BALL = ObjectConfig(shape=Sphere(0.03), mass=0.1, friction=0.8)


def grasp():
    """Takes a ball and lifts it, in two seconds."""
    with Rig(bench_scenario(BALL, home=[0.0, 0.0, 0.2])) as rig:
        rig.advance(1.5, closure=0.8, force_limit=0.5)
        rig.move([0.0, 0.0, 0.3], 0.5)
        return rig, rig.log()


@pytest.fixture(scope="module")
def grasped():
    return grasp()


def test_a_ball_is_taken_by_hand(grasped):
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


def test_the_log_has_a_row_a_period_and_a_column_a_port(grasped):
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


def test_the_arm_follows_its_command(grasped):
    _, log = grasped
    np.testing.assert_array_equal(log["gripper.force_limit"][:, 0], 0.5)
    q, command = log["arm.state_measured"][:, :3], log["arm.position_commanded"]
    assert command[-1, 2] == pytest.approx(0.3, abs=1e-6)
    # 100 rad/s: at 0.375 m/s it is late by no more than two periods of 2 ms.
    assert np.max(np.abs(q - command)) < 0.375 * 0.004


def test_the_same_calls_give_the_same_bits(grasped):
    _, log = grasped
    _, again = grasp()
    assert log.keys() == again.keys()
    for name, array in log.items():
        assert array.tobytes() == again[name].tobytes(), name


def test_commands_may_be_functions_of_time():
    with Rig(bench_scenario(BALL, home=[0.0, 0.0, 0.5]), log_period=0.02) as rig:
        rig.advance(0.1)
        rig.advance(0.1, closure=lambda t: 5.0 * t, arm=lambda t: [t / 10, 0.0, 0.5])
        log = rig.log()
    closure = log["gripper.closure_commanded"][:, 0]
    # A row tells the commands that led to it, the last ones one period old.
    ramp = np.clip(5.0 * (log["time"] - 0.1 - 0.002), 0.0, 1.0)
    np.testing.assert_allclose(closure, ramp, atol=1e-9)
    assert rig.commanded("arm.position_commanded")[0] == pytest.approx(0.0098)


def test_what_is_set_late_was_nan_before():
    with Rig(bench_scenario(BALL)) as rig:
        rig.advance(0.02)
        rig.advance(0.02, force_limit=0.25)
        limit = rig.log()["gripper.force_limit"][:, 0]
    np.testing.assert_array_equal(limit, [np.nan, np.nan, np.nan, 0.25, 0.25])


def test_nothing_is_logged_before_something_happens():
    assert Rig(bench_scenario(BALL)).log() == {}


def test_what_does_not_fit_is_reported():
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


def test_what_drake_gives_up_on_is_reported_with_the_time():
    rig = Rig(bench_scenario(BALL), name="mine")
    rig.advance(0.1)
    with pytest.raises(ScenarioError, match=r"mine: the simulation failed at t = 0\.1"):
        rig.advance(0.1, arm=[np.nan] * 3)


def test_a_video_shows_the_run(tmp_path):
    overrides = ["cameras.overview.width=160", "cameras.overview.height=128"]
    path = tmp_path / "run.mp4"
    with Rig(bench_scenario(BALL, overrides=overrides), video=path) as rig:
        rig.advance(0.2)
    with av.open(str(path)) as container:
        frames = [f.to_ndarray(format="rgb24") for f in container.decode(video=0)]
    assert len(frames) == 4  # 20 Hz
    assert frames[0].shape == (128, 160, 3)
    assert frames[0].std() > 20.0


def test_an_image_shows_what_is_there():
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


def test_a_rig_is_freed(leaked):
    rig = Rig(bench_scenario(BALL))
    rig.advance(0.02)
    assert leaked()
    del rig
    assert leaked() == []


# Motions and scenarios.


@pytest.mark.parametrize("duration", [2.5, 6.0])
def test_shaking_goes_from_rest_to_rest_with_the_acceleration_asked_for(duration):
    motion = rig_module.shake([0.1, 0.2], [9.81, 0.0], 2.0, duration)
    t = np.linspace(0.0, duration, 5001)
    q = np.array([motion(x) for x in t])
    np.testing.assert_array_equal(q[:, 1], 0.2)
    v = np.gradient(q[:, 0], t)
    a = np.gradient(v, t)
    np.testing.assert_allclose(q[[0, -1], 0], 0.1, atol=1e-12)
    np.testing.assert_allclose(v[[0, -1]], 0.0, atol=1e-6)
    assert np.max(np.abs(a)) == pytest.approx(9.81, rel=0.02)


def test_the_example_runs():
    example = textwrap.dedent(rig_module.__doc__.partition("\n\n")[2])
    names = {**vars(rig_module), "household_objects": household_objects}
    exec(example, names)
    assert names["held"]
    assert names["largest_force"] > 1.0


@pytest.mark.parametrize("rpy", [(0, 0, 0), (0, 90, 0), (90, 0, 0), (0, -90, 30)])
def test_the_hand_points_where_it_is_told(rpy):
    rig = Rig(bench_scenario(gripper_rpy=rpy, home=[0.1, -0.2, 0.5]))
    X_WG = rig.X_WG()
    np.testing.assert_allclose(X_WG.translation(), [0.6, -0.2, 0.5], atol=1e-12)
    R = RollPitchYaw(np.deg2rad(rpy)).ToRotationMatrix()
    np.testing.assert_allclose(X_WG.rotation().matrix(), R.matrix(), atol=1e-12)


def test_an_object_takes_the_cans_place():
    bench = bench_scenario(BALL)
    assert list(bench.objects) == [bench.task.pick] == ["thing"]
    assert bench.objects["thing"].position == [0.5, 0.0]
    assert BALL.position is None  # the caller's own stays as it is
    assert list(bench_scenario().objects) == ["soup_can"]


def test_overrides_are_those_of_a_scenario():
    bench = bench_scenario(overrides=["object.mass=2", "plant_config.time_step=0.001"])
    assert bench.objects["soup_can"].mass == 2.0
    assert bench.plant_config.time_step == 0.001
    assert bench_scenario(seed=3).random_seed == 3
