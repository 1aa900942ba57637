"""The planner while a servo moves the arm."""

import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform

from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.pick_and_place.knowledge import (
    Attempt,
    PlannerMemory,
    transition,
)
from drake_srg.planning.planner_machine import Observation
from drake_srg.planning.servoing.config import (
    ServoCommand,
    ServoFault,
    Servoing,
    ServoingConfig,
    ServoState,
    ServoStatus,
    WindowConfig,
)
from drake_srg.planning.servoing.planner import (
    SERVO_TRANSITIONS,
    ServoGrasp,
    ServoIdle,
    ServoingMemory,
    ServoLift,
    ServoSenses,
    servo_command,
    servo_transition,
)
from drake_srg.planning.state_machine import Entry, Moment
from drake_srg.types import Blob, Failure, Mode

CONFIG = Servoing(servo=ServoingConfig(time_limit=3.0))
Q = np.array([0.1, 0.2])
flags = st.booleans()


class FakeReplanner:
    """Plans an escape, or the rest of a cycle, and counts."""

    def __init__(self):
        self.escapes = self.carries = 0

        self.travels, self.waits = [], []

    def find(self, view):
        return view

    def plan(self, view, memory, time, travel=None):
        self.travels.append(travel)

    def wait(self, view, memory, time, place):
        self.waits.append(time)

    def escape(self, memory, time):
        self.escapes += 1
        memory.attempt.escape, memory.attempt.ready_at = (None, None), time + 0.1

    def carry(self, memory, time):
        self.carries += 1
        memory.attempt.trapped = True


def senses(servo):
    zeros = np.zeros(4)
    return ServoSenses(
        q=Q,
        fingers=zeros,
        finger_speeds=zeros,
        grasped=True,
        proximity=zeros,
        see=lambda: None,
        servo=servo,
    )


def now(time, state, **status):
    return Moment(time, senses(ServoStatus(state, q=Q, **status)))


def grasping():
    mode = ServoGrasp(CONFIG, FakeReplanner(), 1)
    memory = PlannerMemory(Motion(np.zeros(2)))
    entry = Entry(1.0, senses(ServoStatus()), Mode.PRE_GRASP, None)
    return mode, mode.enter(memory, entry)


def test_the_fingers_close_once_the_servo_has_reached_the_object():
    mode, memory = grasping()
    assert mode.observe(memory, now(1.5, ServoState.TRACKING)) == Observation()
    memory = mode.update(memory, now(2.0, ServoState.REACHED))
    np.testing.assert_array_equal(memory.motion.q_rest, Q)
    assert mode.observe(memory, now(2.0, ServoState.REACHED)).arrived


@pytest.mark.parametrize(
    ("fault", "failure"),
    [
        (ServoFault.LOST, Failure.NOT_SEEN),
        (ServoFault.FROZEN, Failure.NOT_SEEN),
        (ServoFault.SILENT, Failure.NOT_SEEN),
        (ServoFault.SINGULAR, Failure.NOT_SEEN),
        (ServoFault.STUCK, Failure.OUT_OF_REACH),
    ],
)
def test_a_servo_that_fails_is_left_once_it_rests(fault, failure):
    mode, memory = grasping()
    braking = now(2.0, ServoState.FAILED, fault=fault, at_rest=False)
    memory = mode.update(memory, braking)
    assert mode.replanner.escapes == 0
    for time in (2.1, 2.15):
        memory = mode.update(memory, now(time, ServoState.FAILED, fault=fault))
    assert mode.replanner.escapes == 1
    assert memory.trouble.failure is failure
    assert fault.value in memory.trouble.message
    assert not mode.observe(memory, now(2.15, ServoState.FAILED)).stuck
    assert mode.observe(memory, now(2.3, ServoState.FAILED)).stuck


def test_a_servo_that_takes_too_long_is_left():
    mode, memory = grasping()
    memory = mode.update(memory, now(3.9, ServoState.TRACKING))
    assert mode.replanner.escapes == 0
    assert servo_command(Mode.GRASP, memory) is ServoCommand.TRACK
    memory = mode.update(memory, now(4.1, ServoState.TRACKING, at_rest=False))
    assert memory.trouble.failure is Failure.OUT_OF_REACH
    assert "in time" in memory.trouble.message
    # The escape is planned only once the hand rests.
    assert servo_command(Mode.GRASP, memory) is ServoCommand.HOLD
    assert mode.replanner.escapes == 0
    memory = mode.update(memory, now(4.3, ServoState.HOLDING))
    assert mode.replanner.escapes == 1
    assert "in time" in memory.trouble.message


def test_the_rest_is_planned_from_where_a_servo_has_failed():
    mode = ServoLift(CONFIG, FakeReplanner(), 1)
    memory = PlannerMemory(Motion(Q))
    failed = now(1.0, ServoState.FAILED, fault=ServoFault.STUCK)
    mode.look(memory, failed)
    assert memory.attempt.looked
    assert mode.replanner.carries == 1


def test_the_rest_is_planned_once_the_raised_hand_rests_and_a_failure_ends_it():
    mode = ServoLift(CONFIG, FakeReplanner(), 1)
    memory = PlannerMemory(Motion(Q))
    mode.look(memory, now(1.0, ServoState.RAISING, at_rest=False))
    mode.look(memory, now(1.1, ServoState.HOLDING, at_rest=False))
    assert mode.replanner.carries == 0
    assert mode.observe(memory, now(1.1, ServoState.HOLDING)) == Observation()
    mode.look(memory, now(1.2, ServoState.HOLDING))
    assert mode.replanner.carries == 1
    memory.trouble.failure = Failure.OUT_OF_REACH
    observed = mode.observe(memory, now(1.2, ServoState.HOLDING))
    assert servo_transition(Mode.LIFT, observed, 0.5, CONFIG) is Mode.FAILED


@given(st.sampled_from(list(SERVO_TRANSITIONS)), flags, flags, flags, flags)
def test_all_else_is_as_in_picking_and_placing(mode, arrived, still, holding, ready):
    """Unless the servo fails, both tables agree."""
    seen = Observation(ready=ready, arrived=arrived, still=still, holding=holding)
    assert servo_transition(mode, seen, 1.0, CONFIG) is transition(
        mode, seen, 1.0, CONFIG
    )


def test_the_servo_is_in_charge_from_the_grasp_until_the_lift_is_planned():
    memory = PlannerMemory(Motion(Q))
    commands = {mode: servo_command(mode, memory) for mode in Mode}
    assert commands.pop(Mode.GRASP) is ServoCommand.TRACK
    assert commands.pop(Mode.CLOSE) is ServoCommand.FOLLOW
    assert commands.pop(Mode.VERIFY) is ServoCommand.FOLLOW
    assert commands.pop(Mode.LIFT) is ServoCommand.RAISE
    assert set(commands.values()) == {ServoCommand.PASS}
    memory.attempt.looked = True  # it is planned
    assert servo_command(Mode.LIFT, memory) is ServoCommand.PASS


def blob_at(x):
    return Blob("can", "ceiling", (0.0, 0.0), RigidTransform([x, 0.0, 0.1]), 1.0)


def look_at(sightings, window, memory=None, start=0.0):
    """Look every 0.5 s at an object at each x, None: not seen; return the effects."""
    replanner = FakeReplanner()
    mode = ServoIdle(Servoing(window=window), replanner, 1)
    memory = memory or ServoingMemory(Motion(np.zeros(2)))
    for i, x in enumerate(sightings):
        blob = x if x is None else blob_at(x)
        seen = dc.replace(senses(ServoStatus()), see=lambda blob=blob: blob)
        mode.look(memory, Moment(start + 0.5 * i, seen))
    return replanner


def test_without_a_window_it_plans_at_once_and_knows_no_motion():
    replanner = look_at([0.0], None)
    assert (replanner.travels, replanner.waits) == ([None], [])


@given(st.floats(-0.5, 0.5), st.floats(0.0, 3.0))
def test_it_plans_from_where_the_object_will_be(speed, lead):
    window = WindowConfig(min=[-1.0, -1.0], max=[1.0, 1.0], lead_time=lead)
    replanner = look_at([0.1, 0.1 + 0.5 * speed], window)
    assert replanner.waits == [0.0]
    (travel,) = replanner.travels
    assert travel == pytest.approx([lead * speed, 0.0, 0.0])


def test_it_waits_until_the_object_is_in_the_window():
    window = WindowConfig(min=[0.0, -1.0], max=[1.0, 1.0])
    replanner = look_at([None, -0.2, None, -0.1, 0.0], window)
    assert replanner.waits == [0.0, 0.5, 1.0, 1.5]
    assert len(replanner.travels) == 1


def test_a_sighting_of_an_earlier_attempt_does_not_count():
    memory = ServoingMemory(
        Motion(np.zeros(2)),
        attempt=Attempt(began=4.0),
        before=blob_at(0.0),
        before_at=1.0,
    )
    window = WindowConfig(min=[0.0, -1.0], max=[1.0, 1.0])
    assert look_at([0.5], window, memory, start=4.0).waits == [4.0]
