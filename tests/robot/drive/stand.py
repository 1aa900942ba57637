"""A control loop whose robot and planner are the test's, with a simulated clock."""

import functools
from types import SimpleNamespace

import numpy as np
from pydrake.systems.framework import DiagramBuilder
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.arm.safety.config import SafetyConfig
from drake_srg.arm.safety.limits import JointLimits
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.robot.drive.link import Link, Robot
from drake_srg.robot.drive.opening import Hardware
from drake_srg.robot.drive.remote_planner import Answer, PlannerLink
from drake_srg.robot.drive.run import ControlLoop, MakeHardwareCell
from drake_srg.robot.drive.station import MakeHardwareStation
from drake_srg.robot.serve.commands import Warnings
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Mode, PlannerStatus
from experiments.stands.direct_node import DirectNode
from experiments.stands.direct_node import make_message as make

PERIOD = 0.005
HOME = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.5, 0.0])


@functools.cache
def kitchen():
    return load_scenario("kitchen")


@functools.cache
def limits():
    plant = MakeModelsPlant(kitchen())
    arm = plant.GetModelInstanceByName("arm")
    return JointLimits.of_plant(plant, arm, SafetyConfig(), PERIOD)


class FakeArm(Link):
    """An arm that is at once where it is sent, until its plug is pulled."""

    def __init__(self):
        self.outputs = {"arm.state_measured": 14}
        self.plugged, self.sent, self._last = True, [], HOME

    def take(self):
        if not self.plugged:
            return {}
        q = self.sent[-1] if self.sent else HOME
        v, self._last = (q - self._last) / PERIOD, q
        return {"arm.state_measured": np.concatenate([q, v])}

    def send(self, commands):
        self.sent.append(commands["arm.position_commanded"].copy())

    def close(self):
        pass


class FakeGripper(Link):
    """A gripper that feels nothing."""

    def __init__(self):
        self.outputs = {
            "gripper.state_measured": 8,
            "gripper.proximity": 4,
            "gripper.triggered": 4,
        }
        self.closures, self.holds = [], []

    def take(self):
        return {name: np.zeros(size) for name, size in self.outputs.items()}

    def send(self, commands):
        self.closures.append(commands["gripper.closure_commanded"][0])
        self.holds.append(commands["gripper.hold"][0])

    def close(self):
        pass


class FakePlanner(PlannerLink):
    """A planner that says what the test puts into `answers`."""

    def __init__(self):
        self.ticks, self.answers = [], []

    def post(self, tick):
        self.ticks.append(tick)

    def take(self):
        answers, self.answers = self.answers, []
        return answers

    def say(self, mode, motion=None, time=0.0, closure=0.0, **status):
        report = PlannerStatus(mode=mode, **status)
        self.answers.append(Answer(time, motion, closure, report))


def motion_to(q, duration=2.0, departed=0.0, start=HOME):
    """Return a motion from home, from rest to rest."""
    rest = np.zeros(len(start))
    trajectory = PiecewisePolynomial.CubicWithContinuousSecondDerivatives(
        [0.0, duration], np.stack([start, q], axis=1), rest, rest
    )
    return Motion(start, trajectory, departed, departed + duration)


class Stand:
    """A loop around an arm, a gripper and a planner."""

    def __init__(
        self, arm=None, gripper=None, scenario=None, patience=60.0, release=0.0
    ):
        self.arm, self.gripper = arm or FakeArm(), gripper or FakeGripper()
        start = {"arm.state_measured": np.append(HOME, np.zeros(7)), **self.arm.take()}
        hardware = Hardware([self.arm, self.gripper], {}, start)
        self.build(scenario or kitchen(), hardware, patience, release)

    def build(self, scenario, hardware, patience=60.0, release=0.0):
        self.planner = FakePlanner()
        station = MakeHardwareStation(scenario, hardware)
        builder = DiagramBuilder()
        self.cell = MakeHardwareCell(scenario, station, self.planner, patience)
        builder.AddNamedSystem("cell", self.cell)
        diagram = builder.Build()
        self.loop = ControlLoop("kitchen", scenario, diagram, self.cell, release)

    def run(self, seconds, commands=None):
        """Advance, at most for this time; return whether the run goes on."""
        steps = range(round(seconds / PERIOD))
        return all(self.loop.advance(commands) for _ in steps)


class FakeNode(DirectNode):
    """A ROS node without a wire: the test delivers messages and reads the sent ones."""

    heard = True  # whether others listen

    def has_subscribers(self, topic):
        return self.heard

    def robot(self):
        """Return a robot of the kitchen, whose drivers use this node."""
        names = tuple(f"iiwa_joint_{i}" for i in range(1, 8))
        warnings = Warnings(self.told.append)
        nodes = SimpleNamespace(of=lambda version: self)
        return Robot(kitchen(), names, warnings, nodes)


def joint_state(stamp, names, position, velocity, effort=()):
    """Return a sensor_msgs/JointState."""
    sec, nanosec = divmod(round(stamp * 1e9), 10**9)
    time = make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return make(
        "sensor_msgs/msg/JointState",
        header=make("std_msgs/msg/Header", stamp=time, frame_id=""),
        name=list(names),
        position=np.array(position, dtype=float),
        velocity=np.array(velocity, dtype=float),
        effort=np.array(effort, dtype=float),
    )


def array(data):
    """Return a std_msgs/Float64MultiArray."""
    layout = make("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
    data = np.array(data, dtype=float)
    return make("std_msgs/msg/Float64MultiArray", layout=layout, data=data)


MOVING = Mode.PRE_GRASP
