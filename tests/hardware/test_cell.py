"""The hardware cell with a visual servo, whose arm, camera and planner are ideal."""

import numpy as np
import pytest
from pydrake.math import RigidTransform
from servoing.ideal_hand import arm

from drake_srg.common.safety_states import SafetyState
from drake_srg.hardware.exchange import Answer, Ended
from drake_srg.hardware.link import STAMP
from drake_srg.lifetime import my_context
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.scenario import load_scenario
from drake_srg.servoing.sightings import PoseSighting
from drake_srg.servoing.status import ServoCommand, ServoFault, ServoState
from drake_srg.types import Failure, Mode, PlannerStatus
from hardware.stand import HOME, FakeArm, Stand

_LATE = 0.1  # s
_AHEAD = 7.0  # of the robot's clock [s]
_SILENT = 0.3  # longest time until a servo notices that no image arrives [s]


SCENARIO = load_scenario("kitchen_servoing", overrides=["planner.servo.lag=0"])
PERIOD = SCENARIO.arm.period


class StampedArm(FakeArm):
    """An arm that is at once where it is sent, and says when it was."""

    def __init__(self):
        super().__init__()
        self.time = 0.0

    def take(self):
        self.time += PERIOD
        q, before = [*self.sent[:-3:-1], HOME, HOME][:2]
        state = np.concatenate([q, (q - before) / PERIOD])
        return {"arm.state_measured": state, STAMP: np.array([self.time + _AHEAD])}


class ServoedStand(Stand):
    """A planner that lets a servo track an object, and sees it late."""

    def __init__(self):
        super().__init__(StampedArm(), scenario=SCENARIO)
        context = my_context(self.loop._cell, self.loop._root)
        port = self.loop._cell.GetOutputPort("planner.servo_status")
        self._status = lambda: port.Eval(context)
        servo = self.loop._cell.GetSubsystemByName("servo")
        self.X_GC, self.X_CO_goal = servo._X_GC, servo._X_CO_goal
        self.X_WO = RigidTransform([0.02, -0.03, -0.04]) @ (
            arm().X_WG(HOME) @ self.X_GC @ self.X_CO_goal
        )
        self.broken, self._taken, self._frame = "", [], 0
        self.stopped = []

    @property
    def servo(self):
        return self._status()

    def away(self):
        """How far the hand is from its goal [m]."""
        X_WG_goal = self.X_WO @ (self.X_GC @ self.X_CO_goal).inverse()
        X_WG = arm().X_WG(self.arm.sent[-1])
        return float(np.linalg.norm((X_WG_goal.inverse() @ X_WG).translation()))

    def see(self):
        """Take an image if one is due, and return the one that arrives now, if any."""
        if self.broken == "silent":
            return None
        period = SCENARIO.planner.servo.camera_period
        if self.loop.time >= period * len(self._taken) - 1e-9:
            q = self.arm.sent[-1] if self.arm.sent else HOME
            X_CO = (arm().X_WG(q) @ self.X_GC).inverse() @ self.X_WO
            self._frame += self.broken != "frozen"
            if self.broken == "frozen":
                X_CO = self._taken[-1][1].X_CO
            stamp = self.arm.time + _AHEAD
            seen = PoseSighting(self._frame, X_CO, stamp=stamp)
            self._taken.append((self.loop.time, seen))
        due = [seen for time, seen in self._taken if time <= self.loop.time - _LATE]
        return due[-1] if due else None

    def track(self, seconds, command=ServoCommand.TRACK, answers=True):
        """Advance, while the planner answers every period."""
        for _ in range(round(seconds / PERIOD)):
            seen = self.see()
            if answers:
                motion = Motion(self.servo.q if len(self.servo.q) else HOME)
                status = PlannerStatus(mode=Mode.GRASP)
                time = self.loop.time
                answer = Answer(time, motion, 0.0, status, command, seen)
                self.planner.answers.append(answer)
            self.loop.advance()
            self.stopped.append(self.loop.safety[0] is not SafetyState.RUNNING)


def test_the_hand_reaches_an_object_by_images_that_are_late():
    stand = ServoedStand()
    stand.track(3.0)
    assert stand.servo.state is ServoState.REACHED
    assert stand.away() < 1e-3
    assert not any(stand.stopped)
    tick = stand.planner.ticks[-1]
    assert tick.servo.state is ServoState.REACHED


@pytest.mark.parametrize(
    ("broken", "fault"),
    [("silent", ServoFault.SILENT), ("frozen", ServoFault.FROZEN)],
)
def test_a_camera_that_fails_stops_the_hand_and_is_told(broken, fault):
    stand = ServoedStand()
    stand.track(0.6)
    stand.broken = broken
    stand.track(_LATE + _SILENT + 0.3)
    assert stand.servo.state is ServoState.FAILED
    assert stand.servo.fault is fault
    assert stand.planner.ticks[-1].servo.fault is fault
    np.testing.assert_array_equal(stand.arm.sent[-1], stand.arm.sent[-5])
    assert not any(stand.stopped)


def test_a_planner_that_falls_silent_or_ends_leaves_a_hand_at_rest():
    for ends in (False, True):
        stand = ServoedStand()
        stand.track(0.6)
        assert np.any(stand.arm.sent[-1] != stand.arm.sent[-2])
        if ends:
            stand.planner.answers.append(Ended("it broke"))
        stand.track(0.9, answers=False)
        np.testing.assert_array_equal(stand.arm.sent[-1], stand.arm.sent[-5])
        assert not any(stand.stopped)
        if ends:
            assert stand.loop.status.failure is Failure.STOPPED


def test_a_hand_that_follows_blindly_is_held_without_answers():
    stand = ServoedStand()
    stand.track(0.6)
    stand.track(0.1, ServoCommand.FOLLOW)
    assert stand.servo.state is ServoState.FOLLOWING
    stand.track(1.0, answers=False)
    assert stand.servo.state is ServoState.HOLDING
    assert stand.servo.at_rest


def test_the_arm_goes_back_to_planned_motions_without_a_stop():
    stand = ServoedStand()
    stand.track(0.6)
    was = stand.servo.q  # as the planner knows it; the hand moves on
    assert not stand.servo.at_rest
    stand.track(0.03)
    stand.planner.say(Mode.RELEASE, Motion(was))
    for _ in range(300):
        stand.loop.advance()
    np.testing.assert_allclose(stand.arm.sent[-1], was, atol=1e-4)
    assert stand.loop.safety[0] is SafetyState.RUNNING


def test_a_stop_holds_the_servo():
    stand = ServoedStand()
    stand.track(0.6)
    stand.loop.press_estop()
    stand.track(0.6)
    assert stand.loop.safety[0] is SafetyState.EMERGENCY_STOP
    assert stand.servo.state is ServoState.HOLDING
    np.testing.assert_array_equal(stand.arm.sent[-1], stand.arm.sent[-5])


def test_a_sighting_is_forgotten_once_the_servo_tracks_no_more():
    stand = ServoedStand()
    planner = stand.loop._cell.GetSubsystemByName("planner")
    context = planner.GetMyContextFromRoot(stand.loop._root)
    port = planner.GetOutputPort("sighting")
    stand.track(0.3)
    assert port.Eval(context).stamp > _AHEAD
    stand.broken = "silent"
    stand.track(0.05)
    assert port.Eval(context).stamp > _AHEAD
    stand.track(0.05, ServoCommand.FOLLOW)
    assert np.isnan(port.Eval(context).stamp)
