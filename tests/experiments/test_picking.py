import numpy as np
import pytest

from drake_srg.experiments import picking
from drake_srg.objects.config import ObjectConfig
from drake_srg.planning.grasps.srg_hand import SrgFingers
from drake_srg.planning.grasps.top_grasps import GraspPlan, HeightMapGrasps, Refusal
from drake_srg.types import Box, Failure
from drake_srg.vision.camera_errors import CameraErrorsConfig

BOX = ObjectConfig(shape=Box([0.12, 0.05, 0.06]), mass=0.2, friction=0.7)
NOISE = CameraErrorsConfig(depth_noise=1e-3, depth_dropout=0.01)


class Refuses:
    """A planner that sees a thing and takes nothing."""

    def plan(self, height_map, *, tried=(), seed=0):
        refusal = Refusal(np.zeros(3), (0.2, 0.2), Failure.TOO_WIDE)
        return GraspPlan(things=1, explain=lambda: (refusal,))


@pytest.fixture(scope="module")
def X_WO():
    return picking.rest("box", BOX, np.random.default_rng(3))


def test_a_dropped_box_rests_on_a_face(X_WO):
    up = np.abs(X_WO.rotation().matrix()[2])
    assert up.max() > np.cos(0.03)
    half = 0.5 * np.array(BOX.shape.size)[up.argmax()]
    assert X_WO.translation()[2] == pytest.approx(half, abs=2e-3)
    np.testing.assert_allclose(X_WO.translation()[:2], [0.5, 0.0], atol=0.2)


def test_the_camera_sees_it_where_it_is(X_WO):
    map_ = picking.look(BOX, X_WO, NOISE, seed=5)
    top = X_WO.translation()[2] + BOX.shape.half_extent(X_WO.rotation().matrix()[2])
    iy, ix = map_.cells(X_WO.translation())
    seen = map_.height[iy - 5 : iy + 6, ix - 5 : ix + 6]
    assert np.median(seen) == pytest.approx(top, abs=2.5e-3)
    plan = HeightMapGrasps(SrgFingers(), 0.0, reach=picking.REACH).plan(map_)
    p_WC = plan.grasps[0].p_WC
    np.testing.assert_allclose(p_WC[:2], X_WO.translation()[:2], atol=0.03)


def test_a_thing_without_a_grasp_is_left_with_the_reason():
    (attempt,) = picking.attempts("box", BOX, Refuses(), seed=3)
    assert attempt.grasp is None
    assert not attempt.held
    assert attempt.reason == "too_wide"
