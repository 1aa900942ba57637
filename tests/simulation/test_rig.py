import functools
import textwrap

import av
import numpy as np
import pytest
from pydrake.math import RollPitchYaw

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import household_object
from drake_srg.simulation import rig as rig_module
from drake_srg.simulation.rig import (
    HEIGHT,
    LATE,
    QUIET,
    SOON,
    DropOutcome,
    Rig,
    above_table,
    bench_scenario,
    drop,
    shake,
)
from drake_srg.types import Box, Sphere
from experiments.data import household_objects

BALL = ObjectConfig(shape=Sphere(0.03), mass=0.1, friction=0.8)


@pytest.fixture(scope="module")
def grasped():
    """Grasp a ball and lift it, in two seconds; return rig and log."""
    with Rig(bench_scenario(BALL, home=[0.0, 0.0, 0.2])) as rig:
        rig.advance(1.5, closure=0.8, force_limit=0.5)
        rig.move([0.0, 0.0, 0.3], 0.5)
        return rig, rig.log()


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


@pytest.mark.parametrize("duration", [2.5, 6.0])
def test_shaking_reaches_its_acceleration_and_starts_and_ends_at_rest(duration):
    motion = shake([0.1, 0.2], [9.81, 0.0], 2.0, duration)
    t = np.linspace(0.0, duration, 5001)
    q = np.array([motion(x) for x in t])
    np.testing.assert_array_equal(q[:, 1], 0.2)
    v = np.gradient(q[:, 0], t)
    a = np.gradient(v, t)
    np.testing.assert_allclose(q[[0, -1], 0], 0.1, atol=1e-12)
    np.testing.assert_allclose(v[[0, -1]], 0.0, atol=1e-6)
    assert np.max(np.abs(a)) == pytest.approx(9.81, rel=0.02)


@pytest.mark.parametrize("rpy", [(0, 0, 0), (0, 90, 0), (90, 0, 0), (0, -90, 30)])
def test_the_hand_points_in_the_given_direction(rpy):
    rig = Rig(bench_scenario(gripper_rpy=rpy, home=[0.1, -0.2, 0.5]))
    X_WG = rig.X_WG()
    np.testing.assert_allclose(X_WG.translation(), [0.6, -0.2, 0.5], atol=1e-12)
    R = RollPitchYaw(np.deg2rad(rpy)).ToRotationMatrix()
    np.testing.assert_allclose(X_WG.rotation().matrix(), R.matrix(), atol=1e-12)


def test_a_new_object_takes_the_place_of_the_old_one():
    bench = bench_scenario(BALL)
    assert list(bench.objects) == [bench.task.pick] == ["thing"]
    assert bench.objects["thing"].position == [0.5, 0.0]
    assert BALL.position is None  # the caller's object does not change
    assert list(bench_scenario().objects) == ["soup_can"]


def test_overrides_are_those_of_a_scenario():
    bench = bench_scenario(overrides=["object.mass=2", "plant_config.time_step=0.001"])
    assert bench.objects["soup_can"].mass == 2.0
    assert bench.plant_config.time_step == 0.001


def test_a_home_needs_an_arm():
    overrides = ["arm=null", "planner.steps=[]"]
    with pytest.raises(ScenarioError, match=r"^gripper_bench: home: needs .* an arm$"):
        bench_scenario(home=[0.0], overrides=overrides)


BRICK = ObjectConfig(shape=Box([0.08, 0.06, 0.05]), mass=0.3, friction=0.6)


def test_an_object_is_let_go_just_above_the_table():
    scenario = above_table(BRICK)
    X_WO = scenario.objects["thing"].pose.GetDeterministicValue()
    assert X_WO.translation()[2] == pytest.approx(0.025 + HEIGHT)
    assert BRICK.pose is None


@pytest.mark.slow
def test_a_box_rests_soon():
    outcome = drop(BRICK)
    assert outcome.rests
    assert outcome.after == pytest.approx(SOON)
    assert outcome.speed < QUIET
    assert outcome.moved < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bowl", "011_banana", "029_plate"])
def test_models_rest_here_and_so_does_what_rattles_on_a_rigid_table(name):
    assert drop(household_object(name)).rests


@pytest.mark.slow
def test_what_moves_is_watched_until_the_end(monkeypatch):
    monkeypatch.setitem(drop.__globals__, "QUIET", 0.0)
    outcome = drop(BRICK)
    assert not outcome.rests
    assert outcome.after == pytest.approx(LATE)


@pytest.mark.slow
def test_what_falls_off_the_table_does_not_rest(monkeypatch):
    monkeypatch.setitem(drop.__globals__, "_PLACE", (3.0, 0.0))
    assert not drop(BRICK).rests


def test_outcomes_in_words():
    words = str(DropOutcome(True, 1.2, 4e-4, 1e-4))
    assert words.startswith("rests: 0.4 mm/s 1.2 s after a drop from 5 mm")
    assert str(DropOutcome(False, 3.0, 0.1, 0.0)).startswith(
        "does not rest: 100.0 mm/s"
    )
