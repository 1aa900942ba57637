"""Streams of good and bad messages from a robot: what the arm is sent meanwhile.

A planner moves the kitchen's arm, while the robot's messages are silent for a while,
jump, are old, lack numbers or joints, or have NaN. Each stream is drawn from its seed.
"""

from __future__ import annotations

import dataclasses as dc
import functools
import traceback
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.systems.framework import DiagramBuilder
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.arm.safety.config import SafetyConfig
from drake_srg.arm.safety.limits import JointLimits
from drake_srg.experiments.direct_node import DirectNode
from drake_srg.experiments.fuzzed_messages import FAULTS, FuzzedRobot
from drake_srg.experiments.kept_trials import KeptTrials
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.recording.timeline import make_figure, style_axes
from drake_srg.robot.drive.arm import Ros2Arm
from drake_srg.robot.drive.gripper import Ros2Gripper
from drake_srg.robot.drive.opening import Hardware
from drake_srg.robot.drive.remote_planner import Answer, Ended, PlannerLink, Tick
from drake_srg.robot.drive.run import ControlLoop, MakeHardwareCell
from drake_srg.robot.drive.station import MakeHardwareStation
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Mode, PlannerStatus, Vector

_GOOD = 40  # good messages at the beginning of each stream
_STRETCHES = 8  # most stretches of one event after that
_LONGEST = 15  # of a stretch [control periods]
_ROUNDING = 1e-9  # rad
# The joints move this far from home in this time, which uses 60 % of their speed.
_WAY, _DURATION = np.array([1.0, 0.2, 0.0, 0.3, 0.0, 0.0, 0.4]), 1.5


@dc.dataclass(frozen=True)
class Outcome:
    """What the arm was sent during a stream.

    Attributes:
        events: The faults among it.
        ended: The reason to stop, if the monitor stopped the arm; "" otherwise.
        step: Largest step of a joint, as a share of its limit.
        bend: Largest change of the step, as a share of that of a stop.
        beyond: How far a joint was sent beyond its limits of position [rad].
        error: What was raised, if anything.
    """

    events: tuple[str, ...]
    ended: str
    step: float
    bend: float
    beyond: float
    error: str = ""


class _Planner(PlannerLink):
    """Starts one motion, and says no more."""

    def __init__(self, motion: Motion) -> None:
        status = PlannerStatus(mode=Mode.PRE_GRASP)
        self._answers = [Answer(0.0, motion, 0.0, status)]

    def post(self, tick: Tick) -> None:
        """See `PlannerLink`."""

    def take(self) -> Sequence[Answer | Ended]:
        """See `PlannerLink`."""
        answers, self._answers = self._answers, []
        return answers


@functools.cache
def _kitchen() -> tuple[Scenario, JointLimits]:
    scenario = load_scenario("kitchen", seed=0)
    assert scenario.arm is not None
    plant = MakeModelsPlant(scenario)
    arm = plant.GetModelInstanceByName("arm")
    limits = JointLimits.of_plant(plant, arm, SafetyConfig(), scenario.arm.period)
    return scenario, limits


def stream(seed: int) -> Outcome:
    """Return what the arm is sent while a stream of messages arrives."""
    random = np.random.default_rng(seed)
    scenario, limits = _kitchen()
    assert scenario.arm is not None
    assert scenario.gripper is not None
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
    teller = FuzzedRobot(node, robot.arm_joints, robot.gripper_joints)
    error, q = "", home
    try:
        for event, periods in events:
            for _ in range(periods):
                teller.tell(event, q, period, random)
                loop.advance()
                q = _sent(node, home)[-1]
    except Exception:  # the experiment's question is whether there is one
        error = traceback.format_exc(limit=-1)
    path = _sent(node, home)
    step = np.diff(path, axis=0)
    bend = np.diff(step, axis=0)
    beyond = np.maximum(limits.lower - path, path - limits.upper)
    _, reason = loop.safety
    return Outcome(
        tuple(event for event, _ in events if event != "good"),
        "" if reason.value == "none" else reason.value,
        float(np.max(np.abs(step) / limits.step)),
        float(np.max(np.abs(bend) / limits.brake)),
        float(np.max(beyond)) if np.isfinite(path).all() else np.inf,
        error,
    )


def _sent(node: DirectNode, home: Vector) -> Vector:
    """Return the newest position of each trajectory that was sent, shape (K, N)."""
    rows = [
        message.points[-1].positions
        for topic, message in node.sent
        if topic.name == "/joint_trajectory"
    ]
    return np.array([home, home, home, *rows])


def _stream(seed: int) -> dict[str, Any]:
    return dc.asdict(stream(seed))


def run(track: Track, *, streams: int = 1000, keep: str = "") -> ExperimentResult:
    """Send streams of messages.

    Args:
        track: Shows progress.
        streams: How many; each is its own seed.
        keep: File of finished streams; with it, an experiment that was cut off goes on.
    """
    kept = KeptTrials(keep)
    outcomes = []
    for seed in track(range(streams), lambda seed: f"stream {seed}"):
        done = kept(str(seed), functools.partial(_stream, seed))
        outcomes.append(Outcome(**{**done, "events": tuple(done["events"])}))
    table: dict[str, Any] = {
        "seed": list(range(streams)),
        "faults": [", ".join(o.events) for o in outcomes],
        "stopped by": [o.ended for o in outcomes],
        "step [share of the limit]": [o.step for o in outcomes],
        "change of step [share of the limit]": [o.bend for o in outcomes],
        "error": [o.error for o in outcomes],
    }
    return ExperimentResult(judge(outcomes), {"streams": table}, draw(outcomes))


def judge(outcomes: Sequence[Outcome]) -> list[Row]:
    """Expect no motion beyond the limits, and no exception."""
    total = f"{len(outcomes)} streams"
    unstopped = sum(bool(not o.events and o.ended) for o in outcomes)
    faulty = [o for o in outcomes if o.events]
    most = 1.0 + 1e-6
    return [
        Row.at_most(total, "exceptions", 0, sum(bool(o.error) for o in outcomes), ""),
        Row.at_most(total, "speed / limit", most, max(o.step for o in outcomes), ""),
        Row.at_most(
            total, "deceleration / limit", most, max(o.bend for o in outcomes), ""
        ),
        Row.at_most(
            total,
            "beyond a joint's limits",
            _ROUNDING,
            max(0.0, *(o.beyond for o in outcomes)),
            "rad",
        ),
        Row.at_most(total, "stopped without a fault", 0, unstopped, ""),
        Row.info(total, "with faults", len(faulty), ""),
        Row.info(total, "stopped", sum(bool(o.ended) for o in outcomes), ""),
    ]


def draw(outcomes: Sequence[Outcome]) -> Any:
    """Return a figure of what stopped the arm, by fault."""
    figure = make_figure(8.0, 4.2, "Streams with a fault, and whether the arm stopped")
    axes = figure.add_subplot()
    style_axes(axes, xlabel="streams")
    names, left = [*FAULTS], np.zeros(len(FAULTS))
    for reason in ("", *sorted({o.ended for o in outcomes} - {""})):
        counts = Counter(
            event for o in outcomes if o.ended == reason for event in set(o.events)
        )
        width = np.array([counts[name] for name in names], dtype=float)
        axes.barh(names, width, left=left, label=reason or "went on")
        left += width
    axes.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure
