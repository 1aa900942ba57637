import numpy as np
import pytest
from pydrake.math import RollPitchYaw

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ObjectConfig
from drake_srg.simulation.bench import bench_scenario, shake
from drake_srg.simulation.rig import Rig
from drake_srg.types import Sphere

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
