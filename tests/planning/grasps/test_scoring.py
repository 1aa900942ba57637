"""Scores of pinches and wraps, and their terms."""

import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.planning.grasps.linkage_hand import LinkageFingers
from drake_srg.planning.grasps.scoring import PinchJudge, extent, face_of, lean_of
from drake_srg.planning.grasps.segmentation import Segmentation
from drake_srg.planning.grasps.srg_hand import SrgFingers
from drake_srg.planning.grasps.top_grasps import TABLE_GAP, HeightMapGrasps, Reach
from drake_srg.types import Failure, HeightMap
from planning.grasps.box_maps import TABLE, height_map, turn

STEP = 0.002
S = STEP * np.arange(-40, 41.0)
T = np.linspace(-0.017, 0.017, 11)


def test_extents():
    mask = np.zeros((3, 5), bool)
    mask[0, 1:4] = mask[1, 2] = True
    first, last, some = extent(mask, np.arange(5.0))
    np.testing.assert_array_equal(first, [1, 2, 0])
    np.testing.assert_array_equal(last, [3, 2, 0])
    np.testing.assert_array_equal(some, [True, True, False])


@given(tangent=st.floats(0.0, 1.0), half=st.floats(0.03, 0.05))
def test_the_lean_of_flanks(tangent, half):
    """A ridge whose flanks lean by an angle of a known tangent."""
    for lean in leans(tangent, half, tip=0.0, top=0.05, from_height=0.0):
        # Both ends are found to one step of 2 mm, over a rise of 12 mm.
        assert tangent - 0.34 < lean < tangent + 0.01


def leans(tangent, half, tip, top, from_height):
    """Return the leans of both flanks of a ridge, measured from a height upwards."""
    height = np.clip((half - np.abs(S)) / max(tangent, 1e-9), 0.0, top)
    strip, tip, top = height[None].astype(np.float32), np.full(1, tip), np.full(1, top)
    low, high, _ = extent(strip > from_height, S)
    return [
        lean_of(strip, tip, top, end, inwards, STEP)[0]
        for end, inwards in ((low, 1), (high, -1))
    ]


@given(tangent=st.floats(0.0, 1.0))
def test_the_flanks_of_low_things_lean_from_the_fingers_ends_up(tangent):
    """Regression: fingers slipped off a spoon that lay upside down."""
    # Only the part above 5 mm is between the pads.
    for lean in leans(tangent, 0.025, tip=0.002, top=0.011, from_height=0.005):
        # To a step of 2 mm at both ends, over a rise of 7.2 mm.
        assert tangent - 0.56 < lean < tangent + 0.28


@given(slope=st.floats(-1.0, 1.0))
def test_the_slant_of_a_face(slope):
    distance = slope * T - (slope * T).min()
    share, middle, found = face_of(distance[None], T)
    assert share[0] > 0.0
    if abs(slope) < 0.4:
        np.testing.assert_allclose(found, slope, atol=0.05)
    else:
        assert np.sign(slope) * found[0] > 0.35
        assert np.sign(slope) * middle[0] < 0.0


def test_a_face_that_ends_is_not_slanted():
    distance = np.where(T < 0.005, 0.0, np.inf)
    share, middle, slope = face_of(distance[None], T)
    np.testing.assert_allclose(slope, 0.0, atol=0.05)
    assert 0.5 < share[0] < 0.8
    assert middle[0] < 0.0


HAND = SrgFingers()
JUDGE = PinchJudge(HAND, table_gap=TABLE_GAP)


def segmented(*boxes):
    """Return the segmentation of boxes (x0, x1, y0, y1, height) on a table [m]."""
    map_ = HeightMap(np.full(2, -0.199), 0.002, np.zeros((200, 200)))
    x, y = np.moveaxis(map_.centers(), -1, 0)
    for x0, x1, y0, y1, height in boxes:
        map_.height[(x > x0) & (x < x1) & (y > y0) & (y < y1)] = height
    return Segmentation.of(map_, 0.0, least_height=0.004, least_area=6e-5)


def judge(scene, x=0.0, y=0.0, yaw=0.0):
    found = JUDGE.judge(scene, np.array([[x, y]]), np.array([yaw]))
    return JUDGE.refine(scene, found)


BOX = (-0.025, 0.025, -0.04, 0.04, 0.06)


def test_a_box_between_the_fingers():
    found = judge(segmented(BOX))
    assert np.isfinite(found.score[0])
    assert (found.low[0], found.high[0]) == pytest.approx((-0.025, 0.025), abs=0.002)
    assert found.top[0] == pytest.approx(0.06, abs=1e-6)
    assert found.half_gap[0] > 0.025
    assert 0.0 < found.tip[0] < 0.06


def test_nothing_between_the_fingers():
    assert judge(segmented(BOX), x=0.15).score[0] == -np.inf


def test_better_and_worse_pinches():
    box = segmented(BOX)
    best = judge(box).score[0]
    for worse in (judge(box, yaw=0.3), judge(box, y=0.03), judge(box, yaw=np.pi / 2)):
        assert worse.score[0] < best


def test_a_corner_is_a_wedge():
    corner = judge(
        segmented((-0.06, 0.06, -0.06, 0.06, 0.06)), 0.055, 0.055, -np.pi / 4
    )
    assert corner.score[0] == -np.inf


@pytest.mark.parametrize("far", [0.045, 0.09])
def test_walls_must_leave_room_for_the_fingers(far):
    walls = [(far, far + 0.02, -0.1, 0.1, 0.1), (-far - 0.02, -far, -0.1, 0.1, 0.1)]
    assert np.isfinite(judge(segmented(BOX, *walls)).score[0]) == (far > 0.08)


def test_the_palm_stays_above_what_is_beside_the_fingers():
    # Out of the way of the fingers, below the palm's edge.
    beside = (-0.03, 0.03, 0.022, 0.05, 0.13)
    box = (-0.025, 0.025, -0.015, 0.015, 0.02)
    assert np.isfinite(judge(segmented(box)).score[0])
    assert judge(segmented(box, beside)).score[0] == -np.inf
    low = (*beside[:4], 0.08)
    assert np.isfinite(judge(segmented(box, low)).score[0])


def test_the_best_come_first_without_the_impossible():
    scene = segmented(BOX)
    p_W = np.array([[0.15, 0.0], [0.0, 0.03], [0.0, 0.0]])
    found = JUDGE.judge(scene, p_W, np.zeros(3)).best(5)
    assert len(found.score) == 2
    assert found.score[0] >= found.score[1]
    first = found.take(np.array([0]))
    assert dc.asdict(first)["score"].shape == (1,)


def test_no_places():
    found = JUDGE.judge(segmented(BOX), np.zeros((0, 2)), np.zeros(0))
    assert len(JUDGE.refine(segmented(BOX), found).best(3).score) == 0


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
    away = np.linalg.norm(map_.centers(), axis=-1)
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
