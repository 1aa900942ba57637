import dataclasses as dc

import numpy as np
import pytest

from drake_srg.planning.grasps.candidates import GraspJudgeConfig
from drake_srg.planning.grasps.pinch_judge import PinchJudge
from drake_srg.planning.grasps.relief import Relief
from drake_srg.planning.grasps.srg_fingers import SrgFingers
from drake_srg.types import HeightMap

HAND = SrgFingers()
JUDGE = PinchJudge(HAND, GraspJudgeConfig())


def relief(*boxes):
    """Return the relief of boxes (x0, x1, y0, y1, height) on a table [m]."""
    map_ = HeightMap(np.full(2, -0.199), 0.002, np.zeros((200, 200)))
    x, y = np.moveaxis(map_.middles(), -1, 0)
    for x0, x1, y0, y1, height in boxes:
        map_.height[(x > x0) & (x < x1) & (y > y0) & (y < y1)] = height
    return Relief.of(map_, 0.0, least_height=0.004, least_area=6e-5)


def judge(scene, x=0.0, y=0.0, yaw=0.0):
    found = JUDGE.judge(scene, np.array([[x, y]]), np.array([yaw]))
    return JUDGE.refine(scene, found)


BOX = (-0.025, 0.025, -0.04, 0.04, 0.06)


def test_a_box_between_the_fingers():
    found = judge(relief(BOX))
    assert np.isfinite(found.score[0])
    assert (found.low[0], found.high[0]) == pytest.approx((-0.025, 0.025), abs=0.002)
    assert found.top[0] == pytest.approx(0.06, abs=1e-6)
    assert found.half_gap[0] > 0.025
    assert 0.0 < found.tip[0] < 0.06


def test_nothing_between_the_fingers():
    assert judge(relief(BOX), x=0.15).score[0] == -np.inf


def test_better_and_worse_pinches():
    box = relief(BOX)
    best = judge(box).score[0]
    for worse in (judge(box, yaw=0.3), judge(box, y=0.03), judge(box, yaw=np.pi / 2)):
        assert worse.score[0] < best


def test_a_corner_is_a_wedge():
    corner = judge(relief((-0.06, 0.06, -0.06, 0.06, 0.06)), 0.055, 0.055, -np.pi / 4)
    assert corner.score[0] == -np.inf


@pytest.mark.parametrize("far", [0.045, 0.09])
def test_walls_must_leave_room_for_the_fingers(far):
    walls = [(far, far + 0.02, -0.1, 0.1, 0.1), (-far - 0.02, -far, -0.1, 0.1, 0.1)]
    assert np.isfinite(judge(relief(BOX, *walls)).score[0]) == (far > 0.08)


def test_the_palm_stays_above_what_is_beside_the_fingers():
    # Out of the way of the fingers, below the palm's edge.
    beside = (-0.03, 0.03, 0.022, 0.05, 0.13)
    box = (-0.025, 0.025, -0.015, 0.015, 0.02)
    assert np.isfinite(judge(relief(box)).score[0])
    assert judge(relief(box, beside)).score[0] == -np.inf
    low = (*beside[:4], 0.08)
    assert np.isfinite(judge(relief(box, low)).score[0])


def test_the_best_come_first_without_the_impossible():
    scene = relief(BOX)
    p_W = np.array([[0.15, 0.0], [0.0, 0.03], [0.0, 0.0]])
    found = JUDGE.judge(scene, p_W, np.zeros(3)).best(5)
    assert len(found.score) == 2
    assert found.score[0] >= found.score[1]
    first = found.take(np.array([0]))
    assert dc.asdict(first)["score"].shape == (1,)


def test_no_places():
    found = JUDGE.judge(relief(BOX), np.zeros((0, 2)), np.zeros(0))
    assert len(JUDGE.refine(relief(BOX), found).best(3).score) == 0
