"""A twin beside simulated robots, healthy and faulty: when it reports a difference.

Robot and twin are two simulations of the fast kitchen. The robot does its task by its
own planner, and tells its joints, commands and sightings by the messages of `serve`.
The twin hears these messages alone. Both advance in turn, so that nothing depends on
the machine's speed.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.common.systems import MakeSimulator, output_ports
from drake_srg.experiments.direct_node import DirectNode, make_message
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.lifetime import my_context
from drake_srg.recording.timeline import make_figure, style_axes
from drake_srg.robot.drive.config import HardwareConfig
from drake_srg.robot.serve.pictures import BLOBS, camera_topics, served_camera
from drake_srg.robot.twin.comparison import KINDS
from drake_srg.robot.twin.loop import Listener, Parting, TwinLoop
from drake_srg.robot.twin.station import AddTwin, MakeTwin
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.simulation.flat import MakeRoot
from drake_srg.simulation.recorders import recorded_topics
from drake_srg.station import AddCell, MakeCell
from drake_srg.types import Mode

_SCENARIO = "kitchen_fast"
_PICTURES = 0.2  # time between pictures [s]
_LONGEST = 15.0  # of a run [s]
_OFFSET = 0.05  # of an encoder [rad]
# The push: 40 mm, while the hand is on its way.
_PUSH = "disturbances=[!Push {at: pre_grasp, after: 0.3, displacement: [0, 0.04, 0]}]"


@dc.dataclass(frozen=True)
class Fault:
    """What is wrong with a robot.

    Attributes:
        overrides: Of its scenario; the twin does not know them.
        both: Overrides of both scenarios.
        joint: Index of the joint whose encoder is off by `_OFFSET`; None: none.
        begins: The planner's mode in which the fault can first be noticed; its time is
            that from which reports are counted.
    """

    overrides: tuple[str, ...] = ()
    both: tuple[str, ...] = ()
    joint: int | None = None
    begins: Mode = Mode.CLOSE


# A payload of 2 kg in place of 0.35 kg; torques count while the arm rests, so it looks
# at the can for 0.5 s once that is lifted.
FAULTS: Mapping[str, Fault] = {
    "healthy": Fault(),
    "no friction": Fault(("object.friction=0",)),
    "2 kg in the can": Fault(("object.mass=2",), ("planner.verify_time=0.5",)),
    "weak fingers": Fault(("gripper.motor_strength=0.02",)),
    "can pushed away": Fault((_PUSH,), begins=Mode.PRE_GRASP),
    "encoder 2 off by 0.05 rad": Fault(joint=1, begins=Mode.PRE_GRASP),
    "encoder 6 off by 0.05 rad": Fault(joint=5, begins=Mode.PRE_GRASP),
}
# Faults that a twin is known not to report.
_UNSEEN = {
    "encoder 6 off by 0.05 rad": "the fingers centre the can, so nothing differs enough"
}


@dc.dataclass(frozen=True)
class Beside:
    """A run of a robot with its twin beside it.

    Attributes:
        ended: The planner's mode at the end.
        time: Duration [s].
        begun: When the fault could first be noticed [s].
        partings: What the twin reported.
        largest: Largest difference of each of `KINDS`.
    """

    ended: Mode
    time: float
    begun: float
    partings: Sequence[Parting]
    largest: Sequence[float]

    @property
    def first(self) -> Parting | None:
        """The first report of a difference."""
        return self.partings[0] if self.partings else None


class TalkingRobot:
    """A simulated cell that tells messages to a node.

    Args:
        scenario: Of the cell.
        node: That gets the messages.
        joint: Index of the arm's joint whose encoder is off; None: none.
    """

    def __init__(
        self, scenario: Scenario, node: DirectNode, joint: int | None = None
    ) -> None:
        builder, self._cell = MakeRoot("cell", MakeCell, AddCell, scenario, "robot")
        self._simulator = MakeSimulator(builder.Build(), scenario.simulator_config)
        context = self._simulator.get_mutable_context()
        self._context = my_context(self._cell, context)
        wanted = ("/joint_states", "/gripper/closure_commanded")
        topics = recorded_topics(self._cell, scenario)
        self._topics = [topic for topic in topics if topic.name in wanted]
        self._ports = output_ports(self._cell)
        camera = served_camera(scenario)
        assert camera is not None
        self._blobs = camera_topics(*camera)[BLOBS]
        self._node, self._joint, self._pictured = node, joint, -np.inf

    @property
    def mode(self) -> Mode:
        """The planner's mode."""
        mode: Mode = self._eval("planner.mode")
        return mode

    def advance(self, time: float) -> None:
        """Advance to a time [s], and tell everybody."""
        self._simulator.AdvanceTo(time)
        for topic in self._topics:
            values = [self._eval(port) for port in topic.ports]
            message = topic.convert(make_message, time, *values)
            if self._joint is not None and topic.name == "/joint_states":
                message.position[self._joint] += _OFFSET
            self._node.deliver(topic.name, message)
        if time >= self._pictured + _PICTURES:
            self._pictured = time
            blobs = self._eval("localizer.blobs")
            message = self._blobs.convert(make_message, time, blobs)
            self._node.deliver(BLOBS, message)

    def _eval(self, port: str) -> Any:
        found = self._ports.get(port)
        return None if found is None else found.Eval(self._context)


def beside(name: str, fault: Fault, seed: int, longest: float = _LONGEST) -> Beside:
    """Run a robot with its twin beside it.

    Args:
        name: Of the scenario.
        fault: Of the robot.
        seed: Of both scenarios.
        longest: Most time to simulate [s].
    """
    real = load_scenario(name, seed=seed, overrides=(*fault.both, *fault.overrides))
    ours = load_scenario(name, seed=seed, overrides=fault.both)
    assert real.arm is not None
    node = DirectNode()
    robot = TalkingRobot(real, node, fault.joint)
    listener = Listener(HardwareConfig(), ours.twin, node.robot(ours))
    builder, twin = MakeRoot("twin", MakeTwin, AddTwin, ours, name)
    root, loop = builder.Build(), None
    time, mode, begun, step = 0.0, Mode.IDLE, np.nan, 0
    while time < longest and mode not in (Mode.DONE, Mode.FAILED):
        step += 1
        time = step * real.arm.period
        robot.advance(time)
        mode = robot.mode
        if mode is fault.begins and np.isnan(begun):
            begun = time
        told = listener.take()
        if told is not None and loop is None:
            loop = TwinLoop(name, ours, root, twin, told)
        elif told is not None and loop is not None:
            loop.follow(told)
    assert loop is not None
    return Beside(mode, time, begun, loop.partings, loop.largest.tolist())


def run(track: Track, *, seeds: int = 5, fault_seeds: int = 2) -> ExperimentResult:
    """Run each robot with its twin beside it.

    Args:
        track: Shows progress.
        seeds: Number of runs of the healthy robot.
        fault_seeds: Number of runs with each fault.
    """
    cases = [
        (name, seed)
        for name in FAULTS
        for seed in range(seeds if name == "healthy" else fault_seeds)
    ]
    runs: dict[str, list[Beside]] = {name: [] for name in FAULTS}
    for name, seed in track(cases, lambda case: f"{case[0]}, seed {case[1]}"):
        runs[name].append(beside(_SCENARIO, FAULTS[name], seed))
    rows = [row for name, done in runs.items() for row in judge(name, done)]
    lines = [
        {
            "robot": name,
            "seed": seed,
            "ended": done.ended.value,
            "reports": ", ".join(f"{p.kind} at {p.time:.2f} s" for p in done.partings),
            "first after [s]": done.first.time - done.begun if done.first else np.nan,
            **{f"largest {k}": v for k, v in zip(KINDS, done.largest, strict=True)},
        }
        for name, all_done in runs.items()
        for seed, done in enumerate(all_done)
    ]
    table = {column: [line[column] for line in lines] for column in lines[0]}
    return ExperimentResult(rows, {"runs": table}, draw(runs))


def judge(name: str, runs: Sequence[Beside]) -> list[Row]:
    """Expect silence about a healthy robot, and a report of every fault."""
    total = f"of {len(runs)} runs"
    if name == "healthy":
        done = sum(run.ended is Mode.DONE for run in runs)
        reports = sum(len(run.partings) for run in runs)
        return [
            Row.at_least(name, f"done, {total}", len(runs), done, ""),
            Row.at_most(name, "false reports", 0, reports, ""),
            *(
                Row.info(name, f"largest difference, {kind}", max(values), "")
                for kind, values in zip(
                    KINDS, zip(*(run.largest for run in runs), strict=True), strict=True
                )
            ),
        ]
    after = [run.first.time - run.begun for run in runs if run.first is not None]
    reported = Row.at_least(name, f"reported, {total}", len(runs), len(after), "")
    rows = [reported.because(_UNSEEN.get(name, ""))]
    if after:
        rows.append(Row.info(name, "reported after, latest", max(after), "s"))
    return rows


def draw(runs: Mapping[str, Sequence[Beside]]) -> Any:
    """Return a figure of the reports of each kind over time."""
    figure = make_figure(8.0, 3.4, "What a twin reports about a robot")
    axes = figure.add_subplot()
    style_axes(axes, xlabel="time since the fault could be noticed [s]")
    for kind in KINDS:
        points = [
            (parting.time - run.begun, row)
            for row, all_runs in enumerate(runs.values())
            for run in all_runs
            for parting in run.partings
            if parting.kind == kind
        ]
        axes.plot(*np.reshape(points, (-1, 2)).T, "o", ms=5, label=kind)
    axes.set_yticks(range(len(runs)), runs, fontsize=8)
    axes.set_ylim(len(runs) - 0.5, -0.5)
    axes.legend(fontsize=8, frameon=False)
    return figure
