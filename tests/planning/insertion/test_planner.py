"""The transitions of an insertion, and what it refuses."""

import dataclasses as dc
import itertools

import pytest
from pydrake.math import RigidTransform

from drake_srg.planning.insertion.config import Insert, InsertMode
from drake_srg.planning.insertion.planner import (
    INSERT_TRANSITIONS,
    NOT_INSERTED,
    InsertionPlanner,
    insert_transition,
)
from drake_srg.planning.pick_and_place.sightings import PickTask
from drake_srg.planning.planner_machine import Observation
from drake_srg.types import Failure, Mode, Sphere

CONFIG = Insert()
HELD = Observation(arrived=True, holding=True)
ORDER = (
    *(Mode.PLACE, InsertMode.TILT, InsertMode.SEARCH, InsertMode.SLIDE),
    *(InsertMode.UPRIGHT, InsertMode.PRESS),
)


def following(mode, observation):
    return insert_transition(mode, observation, 1.0, CONFIG)


def test_every_mode_waits_for_its_end():
    for mode in ORDER:
        assert following(mode, Observation(holding=True)) is mode


def test_modes_follow_one_another_until_the_peg_is_seated():
    for mode, next_mode in itertools.pairwise(ORDER):
        assert following(mode, HELD) is next_mode
    seated = dc.replace(HELD, at_goal=True)
    assert following(InsertMode.PRESS, seated) is Mode.RELEASE


@pytest.mark.parametrize(
    ("strategy", "mode"),
    [("push", InsertMode.PRESS), ("spiral", InsertMode.SPIRAL)],
)
def test_other_strategies_skip_the_wall(strategy, mode):
    config = Insert(strategy=strategy)
    assert insert_transition(InsertMode.SEARCH, HELD, 1.0, config) is mode
    assert following(InsertMode.SPIRAL, HELD) is InsertMode.PRESS
    assert following(InsertMode.SPIRAL, Observation(stuck=True)) is InsertMode.WITHDRAW


def test_a_try_that_fails_is_repeated():
    assert following(InsertMode.PRESS, HELD) is InsertMode.WITHDRAW
    stuck = Observation(stuck=True, holding=True)
    assert following(InsertMode.SLIDE, stuck) is InsertMode.WITHDRAW
    assert following(InsertMode.WITHDRAW, HELD) is InsertMode.TILT


@pytest.mark.parametrize("mode", [*InsertMode, Mode.PLACE])
def test_a_lost_peg_opens_the_hand(mode):
    assert following(mode, Observation(arrived=True, holding=False)) is Mode.RELEASE


@pytest.mark.parametrize("failure", [*NOT_INSERTED, Failure.TIME_BUDGET])
def test_reasons_to_give_up_end_every_mode(failure):
    for mode in INSERT_TRANSITIONS:
        ended = mode in (Mode.DONE, Mode.FAILED)
        expected = mode if ended else Mode.FAILED
        assert following(mode, Observation(failure=failure)) is expected


def test_only_cylinders_and_boxes_are_inserted():
    with pytest.raises(ValueError, match=r"objects\.peg: must be a cylinder or a box"):
        InsertionPlanner(None, PickTask("peg", Sphere(0.01), RigidTransform()), CONFIG)
