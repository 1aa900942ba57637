import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.experiments.varied_scenes import (
    WITHIN,
    Obstacles,
    Scene,
    Scenery,
    judge,
    look,
    match,
)
from drake_srg.objects.config import ObjectConfig
from drake_srg.types import Box, Obstacle

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


def test_another_thing_taken_for_the_object_fails():
    assert failed([GOOD] * 39 + [WRONG]) == {"another thing is taken for it"}


@pytest.mark.slow
def test_a_scene_is_always_the_same():
    first, again = look("assistive_arm_varied", 3), look("assistive_arm_varied", 3)
    assert first == again
    assert first.distance < WITHIN["assistive_arm_varied"]


@pytest.mark.slow
def test_a_partly_hidden_can_is_located_beside_a_similar_cup():
    scene = look("kitchen_varied", 37)
    assert scene.certain
    assert scene.distance < WITHIN["kitchen_varied"]


@pytest.fixture(scope="module")
def scenery():
    return Scenery("assistive_arm_varied", 3)


@pytest.mark.slow
def test_the_same_images_are_perceived_again(scenery, monkeypatch):
    first = scenery.look()
    assert scenery.look() == first
    monkeypatch.setattr("drake_srg.vision.color.ColorRange.mask", nothing)
    monkeypatch.setattr("drake_srg.vision.color.ColorRange.mask_in_any_light", nothing)
    assert np.isnan(scenery.look()[0].distance)


def nothing(_, image):
    return np.zeros(image.shape[:2], bool)


@pytest.mark.slow
def test_a_moved_object_is_seen_at_its_new_place():
    scenery = Scenery("assistive_arm_varied", 0, ["object.occlusion=null"])
    x, y, z = scenery.pose().translation()
    X_WO = RigidTransform([x + 0.01, y, z])
    scenery.put(X_WO)
    assert scenery.pose().IsExactlyEqualTo(X_WO)
    assert scenery.look()[0].distance < WITHIN["assistive_arm_varied"]


@pytest.mark.slow
def test_the_kitchens_clutter_is_found():
    _, found = Scenery("kitchen_varied", 0).look()
    assert (found.missed, found.invented, len(found.errors)) == (0, 0, 3)


SIDE, HIGH = 0.04, 0.05


def obstacle(x, height=HIGH, side=SIDE):
    return Obstacle(Box([side, side, height]), RigidTransform([x, 0.0, 0.5 * height]))


def thing(x, height=HIGH):
    config = ObjectConfig(shape=Box([SIDE, SIDE, height]), known=False)
    return RigidTransform([x, 0.0, 0.5 * height]), config


def test_obstacles_are_matched_with_things():
    assert match([], []) == Obstacles(0, 0, ())
    found = match([obstacle(0.0, HIGH + 0.001)], [thing(0.01)])
    assert (found.missed, found.invented) == (0, 0)
    assert found.errors == pytest.approx([0.001])


def test_obstacles_without_a_thing_are_invented_and_things_without_one_missed():
    assert match([obstacle(0.2)], [thing(0.0)]) == Obstacles(1, 1, ())
    # An obstacle at the visible half of a thing covers it, but does not find it.
    assert match([obstacle(0.02, side=0.01)], [thing(0.0)]) == Obstacles(1, 0, ())


def test_two_things_may_make_one_obstacle():
    found = match([obstacle(0.0, side=0.1)], [thing(-0.025), thing(0.025)])
    assert found == Obstacles(0, 0, ())


def test_low_things_need_not_be_found():
    assert match([], [thing(0.0, height=0.005)]) == Obstacles(0, 0, ())
    low = obstacle(0.0, height=0.009)
    assert match([low], [thing(0.0, height=0.005)]) == Obstacles(0, 0, ())
