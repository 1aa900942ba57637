import numpy as np
import pytest
from pydrake.math import RollPitchYaw

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import household_object
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

BALL = ObjectConfig(shape=Sphere(0.03), mass=0.1, friction=0.8)


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


def test_overrides_and_seed_are_those_of_a_scenario():
    bench = bench_scenario(overrides=["object.mass=2", "plant_config.time_step=0.001"])
    assert bench.objects["soup_can"].mass == 2.0
    assert bench.plant_config.time_step == 0.001
    assert bench_scenario(seed=3).random_seed == 3


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
def test_a_model_stands_on_its_origin():
    assert drop(household_object("bowl")).rests


@pytest.mark.slow
@pytest.mark.parametrize("name", ["011_banana", "029_plate"])
def test_what_rattles_on_a_rigid_table_rests_here(name):
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
