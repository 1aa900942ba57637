"""Both servos with ideal features: convergence, and what goes wrong on the way."""

import dataclasses as dc

import numpy as np
import pytest
from helpers import fix, read
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_srg.planning.servoing.config import ServoCommand, ServoFault, ServoState
from drake_srg.planning.servoing.tracker import FeatureSighting, PoseSighting
from drake_srg.planning.servoing.visual_servo import RISE_SPEED
from planning.servoing.ideal_hand import (
    CONFIG,
    HOME,
    KINDS,
    X_GC,
    IdealHand,
    LateHand,
    arm,
    object_at,
)

OFFSET = np.array([0.03, -0.02, -0.05])
aside = st.floats(-0.05, 0.05)


@pytest.fixture(scope="module", params=KINDS)
def kind(request):
    return request.param


UNSEEN = {"pbvs": PoseSighting, "ibvs": FeatureSighting}


@settings(max_examples=4, deadline=None)
@given(st.tuples(aside, aside, st.floats(-0.08, 0.0)))
def test_the_hand_reaches_an_object_at_rest_from_random_starts(kind, offset):
    hand = IdealHand(kind, object_at(offset))
    hand.run(2.5)
    assert hand.status.state is ServoState.REACHED
    assert hand.away() < 1e-3


def test_the_hand_catches_up_with_a_moving_object_and_follows_it_blindly(kind):
    velocity = np.array([0.0, 0.05, 0.0])
    hand = IdealHand(kind, object_at([0.0, -0.05, -0.05]), velocity)
    hand.run(2.5)
    assert hand.status.state is ServoState.REACHED
    np.testing.assert_allclose(hand.status.velocity, velocity, atol=2e-3)
    assert hand.away() < 2e-3
    hand.fix(ServoCommand.FOLLOW)
    hand.run(0.5, UNSEEN[kind]())  # images are now ignored
    assert hand.status.state is ServoState.FOLLOWING
    assert hand.away() < 3e-3


def test_without_feed_forward_the_hand_trails_by_speed_over_gain():
    config = dc.replace(CONFIG, feed_forward=False, funnel=0.0)
    hand = IdealHand("pbvs", object_at(OFFSET), (0.0, 0.05, 0.0), config=config)
    hand.run(2.5)
    trail = 0.05 / config.gain
    assert trail < hand.away() < trail + 0.05 * config.camera_period * 2


def test_a_wrong_calibration_does_not_matter_in_the_end(kind):
    """The goal is an image, so the camera's mounting need not be known."""
    turn = RotationMatrix(RollPitchYaw(np.deg2rad([3.0, -3.0, 3.0])))
    wrong = X_GC @ RigidTransform(turn, [0.012, -0.01, 0.012])
    hand = IdealHand(kind, object_at(OFFSET), X_GC_believed=wrong)
    hand.run(3.0)
    assert hand.status.state is ServoState.REACHED
    assert hand.away() < 1e-3


def test_speed_and_acceleration_stay_within_their_limits(kind):
    hand = IdealHand(kind, object_at([0.05, 0.05, -0.08]))
    p = [arm().X_WG(hand.q).translation()]
    for _ in range(150):
        hand.tick()
        p.append(arm().X_WG(hand.q).translation())
    v = np.diff(p, axis=0) / CONFIG.period
    assert np.max(np.linalg.norm(v, axis=1)) < 1.01 * CONFIG.speed
    a = np.diff(v, axis=0) / CONFIG.period
    assert np.max(np.linalg.norm(a, axis=1)) < 1.1 * CONFIG.acceleration


def test_the_hand_holds_and_tells_once_the_object_leaves_the_image(kind):
    hand = IdealHand(kind, object_at(OFFSET))
    hand.run(0.3)
    hand.run(CONFIG.camera_period, UNSEEN[kind](10_000))
    assert hand.status.fault is ServoFault.LOST
    assert hand.status.state is ServoState.TRACKING
    hand.run(0.2, UNSEEN[kind](10_001))
    assert hand.status.state is ServoState.FAILED
    q = hand.q
    hand.run(0.2)  # even if the object is back
    np.testing.assert_allclose(hand.q, q, atol=1e-9)
    assert hand.status.fault is ServoFault.LOST


def test_an_object_that_is_soon_back_is_reached(kind):
    hand = IdealHand(kind, object_at(OFFSET))
    hand.run(0.3)
    for frame in (10_000, 10_001):
        hand.run(CONFIG.camera_period, UNSEEN[kind](frame))
    assert hand.status.fault is ServoFault.LOST
    hand.run(2.5)
    assert hand.status.fault is None
    assert hand.status.state is ServoState.REACHED


def test_a_frozen_camera_stops_the_hand_within_some_images(kind):
    hand = IdealHand(kind, object_at(OFFSET))
    hand.run(0.3)
    frozen = hand.sight()
    # `patience` images, one that is new, and the time to brake.
    brake = CONFIG.speed / CONFIG.acceleration
    statuses = hand.run((CONFIG.patience + 2) * CONFIG.camera_period + brake, frozen)
    assert statuses[-1].state is ServoState.FAILED
    assert statuses[-1].fault is ServoFault.FROZEN
    q = hand.q
    hand.run(0.1, frozen)
    np.testing.assert_allclose(hand.q, q, atol=1e-9)


def test_equal_images_of_a_hand_at_rest_are_no_fault():
    hand = IdealHand("pbvs", object_at([0.0, 0.0, 0.0]))
    hand.run(1.0, dc.replace(hand.sight(), frame=1))
    assert hand.status.state is ServoState.REACHED
    assert hand.status.fault is None


def test_features_that_determine_nothing_hold_the_hand():
    hand = IdealHand("ibvs", object_at(OFFSET))
    hand.run(0.3)
    point = FeatureSighting(10_000, np.zeros((4, 2)), np.full(4, 0.3))
    hand.run(CONFIG.camera_period, point)
    assert hand.status.fault is ServoFault.SINGULAR
    for frame in range(6):
        hand.run(CONFIG.camera_period, dc.replace(point, frame=20_000 + frame))
    assert hand.status.state is ServoState.FAILED


def test_an_arm_that_cannot_get_there_says_so():
    up = np.zeros(7)
    X_WO = RigidTransform([0.0, 0.0, 0.5]) @ arm().X_WG(up)
    X_WO = X_WO @ RigidTransform([0.18, 0.0, 0.0])
    hand = IdealHand("pbvs", X_WO, q=up)
    hand.run(3.0)
    assert hand.status.state is ServoState.FAILED
    assert hand.status.fault is ServoFault.STUCK
    assert np.max(np.abs(hand.q)) < 1.0


def test_planned_positions_pass_unchanged_and_the_servo_begins_there():
    hand = IdealHand("pbvs", object_at(OFFSET))
    hand.fix(ServoCommand.PASS)
    hand.run(0.1)
    np.testing.assert_array_equal(hand.q, HOME)
    assert hand.status.state is ServoState.PASSING
    hand.fix(ServoCommand.TRACK)
    hand.tick()
    assert np.max(np.abs(hand.q - HOME)) < 0.01
    hand.run(1.0)
    hand.fix(ServoCommand.HOLD)
    hand.run(0.5)
    assert hand.status.at_rest
    hand.fix(ServoCommand.PASS)
    fix(hand.servo, hand.context, position_planned=HOME)
    np.testing.assert_array_equal(
        read(hand.servo, hand.context, "position_commanded"), HOME
    )


def test_a_moving_servo_goes_to_planned_positions_without_a_jump():
    hand = IdealHand("pbvs", object_at([0.05, 0.05, -0.08]))
    hand.run(0.4)
    planned = hand.q.copy()  # a planner knows where the hand was
    hand.run(0.05)
    q = [hand.q]
    hand.fix(ServoCommand.PASS)
    for _ in range(400):
        hand.tick(planned=planned)
        q.append(hand.q)
    np.testing.assert_array_equal(hand.q, planned)
    acceleration = np.diff(q, 2, axis=0) / CONFIG.period**2
    assert np.max(np.abs(acceleration)) < 10.0


def test_a_hand_that_is_told_to_hold_brakes_and_goes_on_when_it_may():
    hand = IdealHand("pbvs", object_at(OFFSET))
    hand.run(0.3)
    hand.fix(ServoCommand.HOLD)
    hand.run(0.5)
    assert (hand.status.state, hand.status.at_rest) == (ServoState.HOLDING, True)
    hand.fix(ServoCommand.TRACK)
    hand.run(2.5)
    assert hand.status.state is ServoState.REACHED


def test_late_images_are_used_where_the_arm_was_then(kind):
    velocity = np.array([0.0, 0.05, 0.0])
    hand = LateHand(kind, object_at([0.0, -0.05, -0.05]), velocity)
    hand.run(3.0)
    assert hand.status.state is ServoState.REACHED
    np.testing.assert_allclose(hand.status.velocity, velocity, atol=2e-3)
    assert hand.away() < 2e-3


def test_images_on_their_way_do_not_count_at_the_goal():
    hand = LateHand("pbvs", object_at([0.0, 0.0, 0.0]))  # it is there already
    statuses = hand.run(1.0)
    first = next(i for i, status in enumerate(statuses) if status.images)
    reached = next(i for i, s in enumerate(statuses) if s.state is ServoState.REACHED)
    # One image, then those of the next 0.1 s, which do not count, then the rest.
    waited = (reached - first) * CONFIG.period
    assert waited > 0.1 + (CONFIG.settled - 2) * CONFIG.camera_period


def test_a_camera_that_falls_silent_stops_the_hand(kind):
    hand = LateHand(kind, object_at(OFFSET))
    hand.run(0.5)
    images, hand.silent = hand.status.images, True
    patience = CONFIG.patience * CONFIG.camera_period
    hand.run(patience + CONFIG.speed / CONFIG.acceleration + 2 * CONFIG.period)
    assert hand.status.state is ServoState.FAILED
    assert hand.status.fault is ServoFault.SILENT
    assert hand.status.at_rest
    assert hand.status.images <= images + 1


def test_looking_once_goes_where_the_first_image_showed_the_goal():
    config = dc.replace(CONFIG, looks=1)
    hand = IdealHand("pbvs", object_at(OFFSET), (0.0, 0.02, 0.0), config=config)
    hand.run(2.5)
    assert hand.status.images == 1
    assert hand.status.state is ServoState.REACHED
    assert hand.away() == pytest.approx(0.02 * hand.time, abs=2e-3)


def test_a_context_can_be_copied():
    hand = IdealHand("pbvs", object_at(OFFSET))
    hand.run(0.1)
    copy = hand.context.Clone()
    fix(hand.servo, copy, command=AbstractValue.Make(ServoCommand.FOLLOW))
    np.testing.assert_array_equal(read(hand.servo, copy, "position_commanded"), hand.q)


def test_a_raised_hand_follows_the_object_brakes_and_rests():
    hand = IdealHand("pbvs", object_at([0.0, -0.05, -0.05]), (0.0, 0.05, 0.0))
    hand.run(2.0)
    p = arm().X_WG(hand.q).translation()
    hand.fix(ServoCommand.RAISE)
    states = [status.state for status in hand.run(0.6)]
    assert states[0] is ServoState.RAISING
    assert states[-1] is ServoState.HOLDING
    assert hand.status.at_rest
    rise = arm().X_WG(hand.q).translation() - p
    assert rise[2] == pytest.approx(CONFIG.rise, abs=0.004)
    assert rise[1] > 0.05 * CONFIG.rise / RISE_SPEED
