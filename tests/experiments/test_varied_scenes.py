import numpy as np
import pytest

from drake_srg.experiments.varied_scenes import WITHIN, Scene, judge, look

GOOD, OFF, UNSEEN = Scene(1e-3, True), Scene(5e-3, True), Scene(np.nan, False)
WRONG, DOUBTED = Scene(0.2, True), Scene(0.2, False)


def failed(scenes):
    return {row.quantity for row in judge("kitchen_varied", scenes) if not row.passed}


def test_good_scenes_pass():
    assert failed([GOOD] * 20) == set()
    assert failed([GOOD] * 19 + [OFF]) == set()


@pytest.mark.parametrize("other", [OFF, UNSEEN, DOUBTED])
def test_too_few_near_ones_fail(other):
    assert failed([GOOD] * 18 + [other] * 2) == {"share seen within 3 mm"}


def test_one_that_is_taken_for_another_thing_fails():
    assert failed([GOOD] * 39 + [WRONG]) == {"another thing is taken for it"}


def test_a_scene_is_always_the_same():
    first, again = look("assistive_arm_varied", 3), look("assistive_arm_varied", 3)
    assert first == again
    assert first.distance < WITHIN["assistive_arm_varied"]


def test_a_can_a_third_hidden_is_seen_beside_a_cup_like_it():
    scene = look("kitchen_varied", 37)
    assert scene.certain
    assert scene.distance < WITHIN["kitchen_varied"]
