"""Streams of good and bad messages from a robot: what the arm is sent meanwhile.

A planner moves the kitchen's arm while the robot's messages are faulty: they stop for a
while, jump, are old, lack numbers or joints, or have NaN. Each stream is drawn from its
seed. The arm must never be commanded beyond its limits, and the program must not raise
an exception.
"""

import dataclasses as dc
import functools
import traceback
from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import DiagramBuilder
from pydrake.trajectories import PiecewisePolynomial

import experiments.runner as ex
from drake_srg.arm.safety.config import SafetyConfig
from drake_srg.arm.safety.limits import JointLimits
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.recording.rosbag import header
from drake_srg.robot.drive.arm import Ros2Arm
from drake_srg.robot.drive.gripper import Ros2Gripper
from drake_srg.robot.drive.opening import Hardware
from drake_srg.robot.drive.remote_planner import Answer, Ended, PlannerLink, Tick
from drake_srg.robot.drive.run import ControlLoop, MakeHardwareCell
from drake_srg.robot.drive.station import MakeHardwareStation
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Mode, PlannerStatus, Vector
from experiments.stands.direct_node import DirectNode, make_message

_GOOD = 40  # good messages at the beginning of each stream
_STRETCHES = 8  # most stretches of one event after that
_LONGEST = 15  # of a stretch [control periods]
# The joints move this far from home in this time, which uses 60 % of their speed.
_WAY, _DURATION = np.array([1.0, 0.2, 0.0, 0.3, 0.0, 0.0, 0.4]), 1.5


@dc.dataclass
class Told:
    """The messages of a robot in one control period, to be corrupted."""

    stamp: float  # s
    names: list[str]  # of the joints, the arm's n first
    q: Vector  # their positions [rad]
    v: Vector  # their speeds [rad/s]
    near: Vector  # the finger sensors' distances [m]
    n: int  # number of the arm's joints
    period: float  # of control [s]

    def keep(self, kept: slice) -> None:
        self.names, self.q, self.v = self.names[kept], self.q[kept], self.v[kept]


# What may happen to the messages of a period.
FAULTS = (
    *("silence", "NaN", "infinite", "huge", "jump", "fast", "old stamp", "same stamp"),
    *("far stamp", "short", "long", "empty", "other joints", "joint twice", "no arm"),
    *("gripper NaN", "gripper short", "no gripper"),
)


def spoil(  # noqa: PLR0912 (one branch per fault)
    told: Told, fault: str, random: np.random.Generator
) -> None:
    """Spoil a message by a fault of `FAULTS`; "silence" changes nothing."""
    n = told.n
    match fault:
        case "NaN":
            told.q[random.integers(n)] = told.v[random.integers(n)] = np.nan
        case "infinite":
            told.q[random.integers(n)] = random.choice([-np.inf, np.inf])
        case "huge":
            told.q, told.v = told.q * 1e30, told.v - 1e30
        case "jump":
            told.q[:n] += random.uniform(-3.0, 3.0, n)
        case "fast":
            told.v[:n] = random.uniform(-30.0, 30.0, n)
        case "old stamp":
            told.stamp = max(told.stamp - random.uniform(0.0, 100.0), 0.0)
        case "same stamp":
            told.stamp -= told.period
        case "far stamp":
            told.stamp += random.uniform(1.0, 1e6)
        case "short":
            told.q = told.q[: random.integers(len(told.q))]
        case "long":
            told.v = np.append(told.v, 1.0)
        case "empty":
            told.keep(slice(0))
        case "other joints":
            told.names[random.integers(n)] = "x"
        case "joint twice":
            told.names[random.integers(n)] = told.names[n - 1]
        case "no arm":
            told.keep(slice(n, None))
        case "gripper NaN":
            told.near[0] = told.q[-1] = np.nan
        case "gripper short":
            told.near = told.near[:2]
        case "no gripper":
            told.keep(slice(n))
            told.near = told.near[:0]


def deliver(node: DirectNode, told: Told) -> None:
    state = make_message(
        "sensor_msgs/msg/JointState",
        header=header(make_message, told.stamp),
        name=told.names,
        position=told.q,
        velocity=told.v,
        effort=np.zeros(0),
    )
    node.deliver("/joint_states", state)
    layout = make_message("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
    kind = "std_msgs/msg/Float64MultiArray"
    near = make_message(kind, layout=layout, data=told.near)
    node.deliver("/gripper/proximity", near)


class _Planner(PlannerLink):
    """A planner that starts one motion and then stays silent."""

    def __init__(self, motion: Motion) -> None:
        status = PlannerStatus(mode=Mode.PRE_GRASP)
        self._answers = [Answer(0.0, motion, 0.0, status)]

    def post(self, tick: Tick) -> None:
        pass

    def take(self) -> Sequence[Answer | Ended]:
        answers, self._answers = self._answers, []
        return answers


@functools.cache
def _kitchen() -> tuple[Scenario, JointLimits]:
    scenario = load_scenario("kitchen", seed=0)
    plant = MakeModelsPlant(scenario)
    arm = plant.GetModelInstanceByName("arm")
    limits = JointLimits.of_plant(plant, arm, SafetyConfig(), scenario.arm.period)
    return scenario, limits


def cases(trials: int = 1000) -> list[ex.Case]:
    return ex.grid(name=[f"{trials} streams"], seed=range(trials))


def trial(name: str, seed: int) -> ex.Measures:
    """Return the commands to the arm while a stream of messages arrives."""
    random = np.random.default_rng(seed)
    scenario, limits = _kitchen()
    home, period = np.array(scenario.arm.home), scenario.arm.period
    node = DirectNode()
    robot = node.robot(scenario)
    links = [Ros2Arm().connect(robot), Ros2Gripper().connect(robot)]
    start = {"arm.state_measured": np.append(home, np.zeros(len(home)))}
    station = MakeHardwareStation(scenario, Hardware(links, {}, start))
    knots = np.stack([home, home + _WAY], axis=1)
    rest = np.zeros(len(home))
    way = PiecewisePolynomial.CubicWithContinuousSecondDerivatives(
        [0.0, _DURATION], knots, rest, rest
    )
    planner = _Planner(Motion(home, way, 0.0, _DURATION))
    cell = MakeHardwareCell(scenario, station, planner, 60.0)
    builder = DiagramBuilder()
    builder.AddNamedSystem("cell", cell)
    loop = ControlLoop("kitchen", scenario, builder.Build(), cell)
    events = [("good", _GOOD)]
    for _ in range(int(random.integers(1, _STRETCHES + 1))):
        event = str(random.choice([*FAULTS])) if random.random() < 0.5 else "good"
        events.append((event, int(random.integers(1, _LONGEST + 1))))
    names, n = [*robot.arm_joints, *robot.gripper_joints], len(home)
    error, stamp = "", 0.0
    try:
        for event in (event for event, periods in events for _ in range(periods)):
            stamp += period
            # The arm is at once where it is sent.
            q, v = np.zeros((2, len(names)))
            q[:n] = _sent(node, home)[-1]
            told = Told(stamp, [*names], q, v, np.full(4, 0.02), n, period)
            spoil(told, event, random)
            if event != "silence":
                deliver(node, told)
            loop.advance()
    except Exception:  # the experiment's question is whether there is one
        error = traceback.format_exc(limit=-1)
    path = _sent(node, home)
    step = np.diff(path, axis=0)
    bend = np.diff(step, axis=0)
    beyond = np.maximum(limits.lower - path, path - limits.upper)
    _, reason = loop.safety
    return {
        "faults": [event for event, _ in events if event != "good"],
        "stopped by": "" if reason.value == "none" else reason.value,
        "speed / limit": np.max(np.abs(step) / limits.step),
        "brake / limit": np.max(np.abs(bend) / limits.brake),
        "beyond": np.max(beyond) if np.isfinite(path).all() else np.inf,
        "error": error,
    }


def _sent(node: DirectNode, home: Vector) -> Vector:
    """Return the newest positions of each trajectory that was sent (K, N) [rad]."""
    rows = [
        message.points[-1].positions
        for topic, message in node.sent
        if topic.name == "/joint_trajectory"
    ]
    return np.array([home, home, home, *rows])


fuzzed_streams = ex.Experiment(
    "Streams of good and bad messages from a robot: what the arm is sent meanwhile.",
    cases,
    trial,
    {
        "exceptions": ex.at_most(0),
        "speed / limit": ex.at_most(1.0 + 1e-6),
        "deceleration / limit": ex.at_most(1.0 + 1e-6),
        "beyond a joint's limits": ex.at_most(1e-9),  # for rounding
        "stopped without a fault": ex.at_most(0),
    },
    summary=lambda own: {
        "exceptions []": sum(bool(t["error"]) for t in own),
        "speed / limit []": max(own["speed / limit"]),
        "deceleration / limit []": max(own["brake / limit"]),
        "beyond a joint's limits [rad]": max(0.0, *own["beyond"]),
        "stopped without a fault []": sum(
            bool(t["stopped by"]) and not len(t["faults"]) for t in own
        ),
        "with faults []": sum(len(t["faults"]) > 0 for t in own),
        "stopped []": sum(bool(t["stopped by"]) for t in own),
    },
    picture=[
        ex.Histogram("speed / limit", label=["stopped by"]),
        ex.Histogram("brake / limit", label=["stopped by"]),
    ],
)
