"""Streams of good and bad messages from a robot: what the arm is sent meanwhile.

A planner moves the kitchen's arm while the robot's messages are faulty: they stop for a
while, jump, are old, lack numbers or joints, or have NaN. Each stream is drawn from its
seed. The arm must never be commanded beyond its limits, and the program must not raise
an exception.
"""

import dataclasses as dc
import functools
import traceback
from collections.abc import Callable, Sequence
from typing import Any

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
        """Leave out joints."""
        self.names, self.q, self.v = self.names[kept], self.q[kept], self.v[kept]


Random = np.random.Generator


def _nan(told: Told, random: Random) -> None:
    told.q[random.integers(told.n)] = told.v[random.integers(told.n)] = np.nan


def _infinite(told: Told, random: Random) -> None:
    told.q[random.integers(told.n)] = random.choice([-np.inf, np.inf])


def _jump(told: Told, random: Random) -> None:
    told.q[: told.n] += random.uniform(-3.0, 3.0, told.n)


def _fast(told: Told, random: Random) -> None:
    told.v[: told.n] = random.uniform(-30.0, 30.0, told.n)


def _other_joint(told: Told, random: Random) -> None:
    told.names[random.integers(told.n)] = "x"


def _joint_twice(told: Told, random: Random) -> None:
    told.names[random.integers(told.n)] = told.names[told.n - 1]


def _gripper_nan(told: Told, random: Random) -> None:
    told.near[0] = told.q[-1] = np.nan


def _set(**values: Callable[[Told, Random], Any]) -> Callable[[Told, Random], None]:
    """Return a fault that sets fields of the messages."""

    def fault(told: Told, random: Random) -> None:
        for name, value in values.items():
            setattr(told, name, value(told, random))

    return fault


# What may happen to the messages of a period; None: there are none.
FAULTS: dict[str, Callable[[Told, Random], None] | None] = {
    "silence": None,
    "NaN": _nan,
    "infinite": _infinite,
    "huge": _set(q=lambda told, r: told.q * 1e30, v=lambda told, r: told.v - 1e30),
    "jump": _jump,
    "fast": _fast,
    "old stamp": _set(
        stamp=lambda told, r: max(told.stamp - r.uniform(0.0, 100.0), 0.0)
    ),
    "same stamp": _set(stamp=lambda told, r: told.stamp - told.period),
    "far stamp": _set(stamp=lambda told, r: told.stamp + r.uniform(1.0, 1e6)),
    "short": _set(q=lambda told, r: told.q[: r.integers(len(told.q))]),
    "long": _set(v=lambda told, r: np.append(told.v, 1.0)),
    "empty": lambda told, random: told.keep(slice(0)),
    "other joints": _other_joint,
    "joint twice": _joint_twice,
    "no arm": lambda told, random: told.keep(slice(told.n, None)),
    "gripper NaN": _gripper_nan,
    "gripper short": _set(near=lambda told, r: told.near[:2]),
    "no gripper": _set(
        names=lambda told, r: told.names[: told.n],
        q=lambda told, r: told.q[: told.n],
        v=lambda told, r: told.v[: told.n],
        near=lambda told, r: told.near[:0],
    ),
}


def deliver(node: DirectNode, told: Told) -> None:
    """Send the messages of a control period."""
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
        """Ignore the measurements."""

    def take(self) -> Sequence[Answer | Ended]:
        """Return the motion at the first call, and then nothing."""
        answers, self._answers = self._answers, []
        return answers


@functools.cache
def _kitchen() -> tuple[Scenario, JointLimits]:
    scenario = load_scenario("kitchen", seed=0)
    plant = MakeModelsPlant(scenario)
    arm = plant.GetModelInstanceByName("arm")
    limits = JointLimits.of_plant(plant, arm, SafetyConfig(), scenario.arm.period)
    return scenario, limits


def cases(streams: int = 1000) -> list[ex.Case]:
    """Send streams of messages.

    Args:
        streams: Number of streams; the index of each is its seed.
    """
    return ex.grid(name=[f"{streams} streams"], seed=range(streams))


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
            spoil = FAULTS.get(event, _set())
            if spoil is not None:
                spoil(told, random)
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
    """Return the newest position of each trajectory that was sent, shape (K, N)."""
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
