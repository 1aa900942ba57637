"""The hardware cell with a visual servo, whose arm, camera and planner are ideal.

Runs on hardware: what is refused, and what is left when a robot dies.
"""

import json
import subprocess
import sys

import numpy as np
import pytest
from helpers import NEEDS_DDS
from planning.servoing.ideal_hand import arm
from pydrake.math import RigidTransform
from rosbags.rosbag2 import Reader

from drake_srg.cli.command import TASK_FAILED
from drake_srg.cli.main import main
from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.safety_states import STATES, SafetyState
from drake_srg.lifetime import my_context
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.servoing.config import ServoCommand, ServoFault, ServoState
from drake_srg.planning.servoing.tracker import PoseSighting
from drake_srg.recording.output import read_log
from drake_srg.robot.drive.config import HardwareConfig
from drake_srg.robot.drive.link import STAMP
from drake_srg.robot.drive.opening import Hardware
from drake_srg.robot.drive.remote_planner import Answer, Ended
from drake_srg.robot.drive.run import ControlLoop, _check_home, check_servo
from drake_srg.scenario import load_scenario
from drake_srg.types import Failure, Mode, PlannerStatus
from robot.drive.stand import HOME, FakeArm, Stand
from robot.serve.ros2.peers import free_domain

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
        self.X_GC, self.X_CO_goal = (
            servo._X_GC,
            RigidTransform(servo.goal.X_CO.translation()),
        )
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


SERVED = "kitchen_fast"
SERVOED = load_scenario("kitchen_servoing")
# Slower than real time, so that a busy machine keeps up.
RATE = 0.1


@pytest.mark.parametrize(
    ("release", "start", "message"),
    [
        (5.0, {STAMP: np.zeros(1)}, "release: must be 0 with planner: !Servoing"),
        (0.0, {}, "planner: !Servoing needs an arm whose states have time stamps"),
    ],
)
def test_what_a_visual_servo_cannot_do_is_refused(release, start, message):
    hardware = Hardware([], {}, start)
    with pytest.raises(ScenarioError, match=message):
        check_servo(SERVOED, HardwareConfig(release=release), hardware)


@pytest.fixture
def robot(tmp_path):
    """A served cell that stands for a robot, and the hardware file that reaches it."""
    domain = str(free_domain())
    file = tmp_path / "robot.yaml"
    file.write_text(
        "arm: !Ros2Arm {}\ngripper: !Ros2Gripper {}\n"
        "cameras: {ceiling: !Ros2Camera {}}\n"
        f"ros2: {{domain: {domain}}}\nrate: {RATE}\npatience: 120.0\n"
    )
    command = [sys.executable, "-m", "drake_srg", "serve", SERVED, "--no-record"]
    command += ["--ros2", "--domain", domain, "--rate", str(RATE)]
    command += ["--set", "arm.limits=null"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline().startswith(SERVED)
            yield process, file
        finally:
            process.kill()


@pytest.mark.parametrize(
    ("scenario", "where"),
    [
        ("kitchen", "joint 4 is 1.900 rad away"),
        ("gripper_bench", "joint 3 is 0.400 m away"),
    ],
)
def test_an_arm_that_is_not_at_home_is_told_in_the_joint_s_unit(scenario, where):
    scenario = load_scenario(scenario)
    start = {"arm.state_measured": np.zeros(2 * len(scenario.arm.home))}
    with pytest.raises(ScenarioError, match=rf"arm\.home: .*, but {where}"):
        _check_home(scenario, Hardware([], {}, start))


@pytest.mark.slow
@NEEDS_DDS
def test_a_robot_that_dies_ends_the_run_in_a_stop_with_a_complete_recording(
    robot, tmp_path, monkeypatch, capsys
):
    process, file = robot
    advance, moving, died_at = ControlLoop.advance, [], []

    def advance_until_it_dies(loop, commands=None):
        goes_on = advance(loop, commands)
        if loop.status.mode is Mode.PRE_GRASP:
            moving.append(loop.time)
            if loop.time > moving[0] + 0.3 and not died_at:
                process.kill()
                died_at.append(loop.time)
        return goes_on

    monkeypatch.setattr(ControlLoop, "advance", advance_until_it_dies)
    out = tmp_path / "out"
    command = ["run", SERVED, "--hardware", str(file), "--out", str(out)]
    assert main(command) == TASK_FAILED
    assert "nothing arrives from the robot any more" in capsys.readouterr().out
    metrics = json.loads((out / "metrics.json").read_text())
    assert (metrics["success"], metrics["claimed"]) == (None, False)
    assert metrics["failure"] == "stopped"
    assert metrics["placement_error_m"] is None
    (stop,) = metrics["safety_stops"]
    assert stop["reason"] == "stale"
    log = read_log(out / "log.npz")
    rests = log["safety.state"][:, 0] == STATES.index(SafetyState.PROTECTIVE_STOP)
    sampling = load_scenario(SERVED).recording.period
    speed = np.abs(log["arm.state_measured"][:, 7:]).max(axis=1)
    assert speed[np.searchsorted(log["time"], died_at[0])] > 0.01
    assert log["time"][rests][0] < died_at[0] + 0.2 + sampling
    with Reader(out / "recording.mcap") as reader:
        assert reader.message_count > 0
        assert reader.duration * 1e-9 > died_at[0]
    assert (out / "timeline.png").stat().st_size > 0
