"""Grasps and picks of labelled things."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.planning.clearing.choosing import ChoosingPlanner, ChosenGrasps, label_of
from drake_srg.planning.grasps.srg_hand import SrgFingers
from drake_srg.types import Failure, HeightMap, LabeledHeightMap, Mode
from planning.clearing.fake_table import CONFIG, Grasps, Motions, Run, table

A, B = (0.1, 0.1), (0.3, 0.2)
NAMES = ("a", "b")
FEW = settings(max_examples=4, deadline=None)


def labeled(height_map, *places):
    """Label what stands within 30 mm of each place, in order."""
    label = np.full(height_map.height.shape, -1, np.int8)
    for i, place in enumerate(places):
        near = np.abs(height_map.centers() - place).max(axis=-1) < 0.03
        label[near & (height_map.height > 0.0)] = i
    return LabeledHeightMap(
        height_map.origin, height_map.resolution, height_map.height, label, NAMES
    )


def fine(*places):
    """Return a map of 2 mm cells with a block of 50 mm at each place."""
    found = HeightMap(np.full(2, -0.199), 0.002, np.zeros((200, 200)))
    for place in places:
        near = np.abs(found.centers() - place).max(axis=-1) < 0.025
        found.height[near] = 0.05
    return found


@FEW
@given(st.floats(-0.12, -0.05), st.floats(-0.1, 0.1))
def test_only_labelled_things_are_grasped(x, y):
    chosen, other = (x, y), (x + 0.15, y)
    planner = ChosenGrasps(SrgFingers(), 0.0)
    seen = labeled(fine(chosen, other), chosen)
    plan = planner.plan(seen)
    assert plan.grasps
    for grasp in plan.grasps:
        assert np.linalg.norm(grasp.p_WC[:2] - chosen) < 0.035
        assert label_of(grasp, seen, 0.0) == 0
    assert plan.refused == ()


def test_nothing_is_grasped_without_labels():
    assert ChosenGrasps(SrgFingers(), 0.0).plan(labeled(fine((0.0, 0.0)))).grasps == ()


def test_things_that_touch_are_not_taken_together():
    left, right = (-0.025, 0.0), (0.025, 0.0)
    seen = fine(left, right)
    # Across both, the pair is 100 mm wide, which the hand takes.
    both = labeled(seen, left, right)
    planner = ChosenGrasps(SrgFingers(), 0.0)
    for grasp in planner.plan(both).grasps:
        assert grasp.width < 0.075
        assert label_of(grasp, both, 0.0) in (0, 1)


def test_a_labelled_thing_beside_another_is_wrapped_alone():
    seen = fine()
    away = np.abs(seen.centers())
    seen.height[(away[..., 0] < 0.104) & (away[..., 1] < 0.079)] = 0.066
    seen.height[(away[..., 0] > 0.104) & (away[..., 0] < 0.14)] = 0.02
    labels = labeled(seen)
    labels.label[seen.height == 0.066] = 0
    (best, *_) = ChosenGrasps(SrgFingers(), 0.0).plan(labels).grasps
    assert best.wrapped
    assert label_of(best, labels, 0.0) == 0


def choosing_run(shown, required=(True, True)):
    """Return a run of a ChoosingPlanner, and its motions for each label."""
    to = [Motions(), Motions()]
    grasps = Grasps((A, B))
    planner = ChoosingPlanner(grasps, to, NAMES, required, 0.0, CONFIG)
    return Run(grasps, to[0], shown, CONFIG, picks=planner), to


def pick(run, *, after, then=Mode.RELEASE):
    run.until(Mode.CLOSE)
    run.feel(True)
    run.until(Mode.TRANSFER)
    run.show(after)
    run.until(then)
    run.feel(False)


def test_each_thing_goes_to_its_own_place():
    run, to = choosing_run(labeled(table(A, B), A, B))
    pick(run, after=labeled(table(B), A, B))
    pick(run, after=labeled(table(), A, B))
    run.until(Mode.DONE)
    assert [motions.taken for motions in to] == [[A], [B]]
    assert run.status.cycles == 2


def test_a_name_that_is_not_seen_is_told():
    run, _ = choosing_run(labeled(table(A), A, B))
    pick(run, after=labeled(table(), A, B), then=Mode.FAILED)
    assert run.status.failure is Failure.NOT_SEEN
    assert run.status.message == "the cameras see no b on the table"


def test_a_colour_that_nothing_has_is_told():
    run, _ = choosing_run(labeled(table(A)), required=(False, False))
    run.grasps.places = ()
    run.until(Mode.FAILED)
    assert run.status.message == "the cameras see no a, b on the table"
    assert run.status.attempts == 0


def test_a_grasp_of_nothing_that_has_a_label_is_left():
    # The planner of grasps offers one of B, which has no label here.
    run, to = choosing_run(labeled(table(A, B), A), required=(True, False))
    pick(run, after=labeled(table(B), A))
    run.until(Mode.DONE)
    assert [motions.taken for motions in to] == [[A], []]


def test_of_colours_one_may_be_missing():
    run, _ = choosing_run(labeled(table(A), A, B), required=(False, False))
    pick(run, after=labeled(table(), A, B))
    run.until(Mode.DONE)
    assert run.status.cycles == 1


def test_what_is_placed_is_lowered_and_left_before_the_next_look():
    run, to = choosing_run(labeled(table(A), A))
    to[0].places = True
    run.until(Mode.CLOSE)
    run.feel(True)
    run.until(Mode.PLACE)
    run.show(labeled(table(), A))
    run.until(Mode.RELEASE)
    run.feel(False)
    run.until(Mode.RETREAT)
    run.until(Mode.FAILED)  # because b was never seen
    assert run.status.cycles == 1
