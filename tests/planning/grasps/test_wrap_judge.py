import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.planning.grasps.height_map_grasps import HeightMapGrasps, Reach
from drake_srg.planning.grasps.linkage_fingers import LinkageFingers
from drake_srg.planning.grasps.srg_fingers import SrgFingers
from drake_srg.types import Failure
from planning.grasps.box_maps import TABLE, height_map, turn

HAND = SrgFingers()
PLANNER = HeightMapGrasps(HAND, TABLE)
FEW = settings(max_examples=6, deadline=None)
FLAT = (0.21, 0.158, 0.066)  # a cracker box on its widest side [m]


def plan(*boxes, planner=PLANNER, noise=0.0):
    return planner.plan(height_map(*boxes, noise=noise, half=0.25))


@FEW
@given(
    yaw=st.floats(-np.pi, np.pi),
    width=st.floats(0.145, 0.160),
    height=st.floats(0.05, 0.15),
    noise=st.sampled_from([0.0, 0.001]),
)
def test_a_box_that_is_too_wide_for_a_pinch_is_wrapped(yaw, width, height, noise):
    found = plan((0.02, 0.01, yaw, 0.21, width, height), noise=noise)
    assert not found.refused
    best = found.grasps[0]
    assert best.wrapped
    assert turn(best.yaw, yaw + 0.5 * np.pi) < np.deg2rad(10)
    assert best.width == pytest.approx(width, abs=0.012)
    across = np.array([-np.sin(yaw), np.cos(yaw)])
    assert abs((best.X_WG.translation()[:2] - [0.02, 0.01]) @ across) < 0.008
    # The open fingers end up just above the box, and the tips close above the table.
    palm = best.X_WG.translation()[2] - TABLE
    assert 0.0 < palm - HAND.wrap.face_x - height < 0.012
    assert palm - HAND.wrap.deepest > 0.0


@pytest.mark.parametrize(
    ("length", "width", "height"),
    [(0.21, 0.158, 0.044), (0.21, 0.18, 0.066)],
    ids=["the tips would touch the table", "too wide for a wrap, too"],
)
def test_what_stays_too_wide(length, width, height):
    found = plan((0.0, 0.0, 0.3, length, width, height))
    assert found.grasps == ()
    assert [r.failure for r in found.refused] == [Failure.TOO_WIDE]


def test_tips_need_room_beside_the_thing():
    beside = [(0.0, y, 0.0, 0.3, 0.04, 0.09) for y in (-0.13, 0.13)]
    found = plan((0.0, 0.0, 0.0, *FLAT), *beside)
    assert not any(grasp.wrapped for grasp in found.grasps)
    (box,) = (r for r in found.refused if np.linalg.norm(r.p_W[:2]) < 0.02)
    assert box.failure == Failure.BLOCKED


def test_low_things_beside_it_are_out_of_the_way():
    beside = (0.0, 0.13, 0.0, 0.3, 0.04, 0.01)
    found = plan((0.0, 0.0, 0.0, *FLAT), beside)
    assert any(grasp.wrapped for grasp in found.grasps)


def test_what_a_pinch_takes_is_not_wrapped():
    found = plan((0.0, 0.0, 0.0, 0.21, 0.08, 0.066))
    assert found.grasps
    assert not any(grasp.wrapped for grasp in found.grasps)


def test_a_dome_has_no_edges_to_hold():
    map_ = height_map(half=0.25)
    away = np.linalg.norm(map_.middles(), axis=-1)
    map_.height[:] += 0.08 * np.sqrt(np.clip(1.0 - (away / 0.079) ** 2, 0.0, None))
    assert PLANNER.plan(map_).grasps == ()


def test_other_hands_need_not_wrap():
    hand = HeightMapGrasps(LinkageFingers(), TABLE)
    found = plan((0.0, 0.0, 0.0, *FLAT), planner=hand)
    assert found.grasps == ()


def test_a_hand_that_cannot_wrap_says_so():
    with pytest.raises(NotImplementedError, match="LinkageFingers"):
        LinkageFingers().wrapped(0.15)


def test_a_thing_cut_off_by_the_edge_of_the_map_may_be_wider_than_it_looks():
    assert plan((0.25, 0.0, 0.0, 0.3, 0.21, 0.066)).grasps == ()


def test_wraps_are_where_the_hand_reaches():
    reach = Reach((0.0, 0.0), 0.0, 0.03)
    hand = HeightMapGrasps(HAND, TABLE, reach=reach)
    found = plan((0.02, 0.0, 0.0, *FLAT), planner=hand)
    assert found.grasps
    assert all(reach.contains(g.X_WG.translation()[None]).all() for g in found.grasps)
    far = plan((0.14, 0.0, 0.0, *FLAT), planner=hand)
    assert far.grasps == ()
    assert far.refused


def test_a_wrap_that_failed_comes_last():
    scene = height_map((0.0, 0.0, 0.0, *FLAT), half=0.25)
    first = PLANNER.plan(scene).grasps[0]
    again = PLANNER.plan(scene, tried=[first]).grasps
    assert not again[0].like(first, 0.012, 0.35)
    assert again[-1].like(first, 0.024, 0.35)


def test_things_are_pinched_before_others_are_wrapped():
    small = (-0.19, 0.19, 0.0, 0.06, 0.05, 0.05)
    found = plan((0.03, -0.03, 0.0, *FLAT), small)
    kinds = [grasp.wrapped for grasp in found.grasps]
    assert True in kinds
    assert kinds == sorted(kinds)
