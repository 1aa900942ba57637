"""The loop of a served station, in step with real time."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import math
import threading
import time as wall
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, InputPort
from pydrake.systems.primitives import PassThrough

from drake_srg.arm.driver import AddJerkLimits, ArmDriver
from drake_srg.arm.reference import JerkLimitedReference, TrajectoryFollower
from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.real_time import real_time_loop
from drake_srg.common.systems import (
    MakeSimulator,
    export_outputs,
    input_ports,
    output_ports,
)
from drake_srg.lifetime import my_context
from drake_srg.recording.output import output_folder
from drake_srg.recording.replay import write_page
from drake_srg.recording.rosbag import Topic
from drake_srg.robot.serve.action_server import ActionServer
from drake_srg.robot.serve.bridge import Bridge, Outlet
from drake_srg.robot.serve.commands import (
    ONE_ARM,
    TRAJECTORY,
    CommandInbox,
    CommandTopic,
    SafetyGate,
    Warnings,
    port_of,
    safety_topics,
    station_topics,
)
from drake_srg.robot.serve.pictures import PERIOD, Pictures
from drake_srg.scenario import RobotArm, Scenario, robot_arms
from drake_srg.simulation import failure_time
from drake_srg.simulation.flat import MakeRoot
from drake_srg.simulation.recorders import AddRosbagRecorder, recorded_topics
from drake_srg.simulation.run_log import Samples
from drake_srg.station import MakeStation
from drake_srg.station.sleeping import Advance, MakeAdvance
from drake_srg.types import Vector

# A run is too slow if it reaches less than this share of its rate in two consecutive
# windows of this length [s, real]. A single stall does not count.
_KEPT, _WINDOW = 0.97, 5.0


class Pacer:
    """Lets simulated time pass at a multiple of real time, or as fast as possible.

    Args:
        rate: Simulated seconds per real second; infinite: never wait.
        stop: Ends a wait when it is set.
        patience: The simulation catches up with delays of at most this length [s,
            real]. It gives up longer ones, so that it never rushes for long.
        clock: Returns real time [s].

    Attributes:
        lost: Real time given up so far [s].
        too_slow: Ratio of simulated to real time if the run is too slow, else None.
    """

    def __init__(
        self,
        rate: float,
        stop: threading.Event,
        *,
        patience: float = 0.5,
        clock: Callable[[], float] = wall.monotonic,
    ):
        self._rate, self._stop = rate, stop
        self._patience, self._clock = patience, clock
        self.lost = 0.0
        self.too_slow: float | None = None
        self._start = clock()  # real time that corresponds to simulated time 0 [s]
        # (real, simulated) times of about the last second.
        self._recent: deque[tuple[float, float]] = deque([(self._start, 0.0)])
        self._window, self._slow_windows = (self._start, 0.0), 0

    def wait(self, time: float) -> None:
        """Wait until real time has caught up with the simulated `time` [s]."""
        now = self._clock()
        if math.isfinite(self._rate):
            ahead = self._start + time / self._rate - now
            if ahead > 0.0:
                self._stop.wait(ahead)
            elif ahead < -self._patience:
                self.lost -= ahead
                self._start -= ahead
            self._judge(now, time)
        self._recent.append((now, time))
        while now - self._recent[0][0] > 1.0 and len(self._recent) > 2:
            self._recent.popleft()

    def _judge(self, now: float, time: float) -> None:
        """Decide at the end of each window whether the run is too slow."""
        real, simulated = self._window
        if now - real >= _WINDOW:
            factor = (time - simulated) / (now - real)
            slow = factor < _KEPT * self._rate
            self._slow_windows = self._slow_windows + 1 if slow else 0
            self.too_slow = factor if self._slow_windows > 1 else None
            self._window = (now, time)

    @property
    def factor(self) -> float:
        """Ratio of simulated to real time during the last second."""
        (real_0, time_0), (real_1, time_1) = self._recent[0], self._recent[-1]
        return (time_1 - time_0) / max(real_1 - real_0, 1e-9)


def MakeServedStation(scenario: Scenario) -> Diagram:
    """Build the diagram of a station that external clients command.

    .. pydrake_system::

        name: ServedStation
        input_ports:
        - (all of the station's except arm.position_commanded)
        - arm.position_desired (with `arm.limits`)
        - arm.trajectory_desired (without)
        output_ports:
        - (all of the station's except the cameras')
        - arm.position_commanded
        - gripper.closure_commanded

    `arm.position_desired` (N) [rad or m] reaches the arm through a
    `JerkLimitedReference`, which starts at the arm's home position, and after a stop
    where the arm rests. Without `arm.limits`, the port is `arm.trajectory_desired`, and
    a `TrajectoryFollower` moves the arm. With `arms`, ports begin with `NAME.` as those
    of the station, but all arms share `safety.estop` and the other inputs of safety
    monitors. The subsystem `station` is the station without cameras;
    `MakeRemoteCameras` renders its plant's state in another process.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """
    builder = DiagramBuilder()
    AddServedStation(builder, scenario)
    diagram = builder.Build()
    diagram.set_name("served_station")
    return diagram


def AddServedStation(
    builder: DiagramBuilder,
    scenario: Scenario,
    make_station: Callable[[Scenario], Diagram] = MakeStation,
) -> None:
    """Add the systems of `MakeServedStation` to a diagram, and export their ports.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """
    without_cameras = dc.replace(scenario, cameras={})
    station = builder.AddNamedSystem("station", make_station(without_cameras))
    export_outputs(builder, station)
    inputs = input_ports(station)
    for robot in robot_arms(scenario):
        if robot.arm is not None:
            _AddReference(builder, station, inputs, robot, robot.arm)
        if robot.gripper is not None:
            name = f"{robot.gripper_model}.closure_commanded"
            command = builder.AddNamedSystem(
                robot.system("closure_commanded"), PassThrough(1)
            )
            builder.Connect(command.get_output_port(), inputs.pop(name))
            builder.ExportInput(command.get_input_port(), name)
            builder.ExportOutput(command.get_output_port(), name)
    exported = set[str]()
    for name, port in inputs.items():
        shared = _shared(name, robot_arms(scenario))
        if shared in exported:
            builder.ConnectInput(shared, port)
        else:
            builder.ExportInput(port, shared)
        exported.add(shared)


def _shared(port: str, robots: Sequence[RobotArm]) -> str:
    """Return the name to export an input port by: all arms share those of safety."""
    prefixes = tuple(f"{robot.prefix}safety." for robot in robots)
    return port[port.index("safety.") :] if port.startswith(prefixes) else port


def _AddReference(
    builder: DiagramBuilder,
    station: Diagram,
    inputs: dict[str, InputPort],
    robot: RobotArm,
    arm: ArmDriver,
) -> None:
    """Add the system that moves an arm to targets, and pop its port from `inputs`."""
    commanded = f"{robot.arm_model}.position_commanded"
    name = robot.system("arm_reference")
    reference: JerkLimitedReference | TrajectoryFollower
    if arm.limits is None:
        follower = TrajectoryFollower(np.array(arm.home), arm.period)
        reference = builder.AddNamedSystem(name, follower)
    else:
        reference = AddJerkLimits(builder, arm, name)
    builder.Connect(reference.get_output_port(), inputs.pop(commanded))
    held = f"{robot.arm_model}.position_held"
    if held in output_ports(station):
        builder.Connect(
            station.GetOutputPort(held), reference.GetInputPort("position_held")
        )
    desired = reference.get_input_port(0)
    builder.ExportInput(desired, f"{robot.arm_model}.{desired.get_name()}")
    builder.ExportOutput(reference.get_output_port(), commanded)


LONGEST = 120.0  # longest replay [s]: a browser holds all of it in memory


class ServedReplay:
    """Samples the first two minutes of a served station for a replay.

    Args:
        scenario: The served scenario; it must have an arm.
    """

    def __init__(
        self, name: str, scenario: Scenario, root: Diagram, station: Diagram
    ) -> None:
        self._samples = Samples(name, scenario, root, station, replayed=True)
        self._period, self._next = scenario.recording.period, 0.0

    def sample(self, root: Context) -> None:
        """Add a sample if one is due."""
        time = root.get_time()
        if time < self._next - 1e-9 or time > LONGEST:
            return
        self._next = time + self._period
        self._samples.add(root)

    def write(self, out: Path) -> Path | None:
        """Write replay.html and the files that it contains.

        Returns:
            The path of replay.html; None if nothing was sampled.

        Raises:
            OSError: If a file cannot be written.
        """
        return write_page(out) if self._samples.write(out) else None


def control_period(scenario: Scenario) -> float:
    """Return the time between reads of the inbox [s]: the arm driver's period."""
    periods = [robot.arm.period for robot in robot_arms(scenario) if robot.arm]
    return min(periods, default=scenario.plant_config.time_step or 1.0 / 256.0)


def MakeActionServers(scenario: Scenario, station: Diagram) -> list[ActionServer]:
    """Return an action server for each arm that follows trajectories."""
    plant = station.GetSubsystemByName("station").GetSubsystemByName("plant")
    return [
        ActionServer(plant, robot.arm.period, robot)
        for robot in robot_arms(scenario)
        if robot.arm and port_of(robot, TRAJECTORY) in input_ports(station)
    ]


def station_inbox(
    scenario: Scenario,
    station: Diagram,
    warnings: Warnings,
    others: Iterable[CommandTopic] = (),
) -> CommandInbox:
    """Return the inbox for all commands that a served station obeys.

    Args:
        scenario: The scenario.
        station: A station from `MakeServedStation`.
        warnings: Receives reports of refused commands.
        others: Further topics, which do not command input ports.
    """
    plant = station.GetSubsystemByName("station").GetSubsystemByName("plant")
    inputs, period = input_ports(station), control_period(scenario)
    commands = []
    for robot in robot_arms(scenario):
        joints = () if robot.gripper is None else robot.gripper.joint_names
        commands += station_topics(plant, inputs, joints, robot, period)
    return CommandInbox([*commands, *safety_topics(inputs), *others], warnings)


def fix_defaults(station: Diagram, context: Context) -> None:
    """Command the grippers to open until a client commands them."""
    for name, port in input_ports(station).items():
        if name.endswith(("gripper.closure_commanded", "gripper.closure_messages")):
            port.FixValue(context, [0.0])


class Shown(Protocol):
    """Publishes pictures, such as `Pictures`."""

    def look(
        self, time: float, plant_state: Callable[[], Vector], outlet: Outlet
    ) -> None:
        """Publish the cameras' pictures of the plant's state at a time [s]."""


class ServedLoop:
    """Advances a served station by one control period after another.

    Args:
        simulator: The root diagram's simulator, initialized.
        station: A station from `MakeServedStation`.
        topics: The topics of the station.
        pictures: The cameras' topics.
        replay: Takes samples for a replay; None: no replay.
        actions: The arms' action servers, connected.
    """

    def __init__(
        self,
        name: str,
        simulator: Simulator,
        advance: Advance,
        station: Diagram,
        topics: Sequence[Topic],
        pictures: Shown,
        inbox: CommandInbox,
        outlet: Outlet,
        replay: ServedReplay | None = None,
        actions: Sequence[ActionServer] = (),
        robots: Sequence[RobotArm] = (ONE_ARM,),
    ) -> None:
        self._replay, self._actions = replay, actions
        self._name, self._simulator, self._advance = name, simulator, advance
        self.inbox, self.outlet = inbox, outlet
        self._topics, self._pictures = topics, pictures
        self._root = simulator.get_mutable_context()
        self._station = station
        self._context = my_context(station, self._root)
        self._ports = output_ports(station)
        self._gate = SafetyGate(station, inbox.warnings, robots)
        # The integrator of a continuous plant chooses its own steps. A control period
        # then counts as one step.
        self._plant = station.GetSubsystemByName("station").GetSubsystemByName("plant")
        self._plant_step = self._plant.time_step() or math.inf
        self._wanted = sorted({name for b in outlet.bridges for name in b.ports})

    def advance(self, until: float) -> None:
        """Apply the commands, advance to a time [s] and publish.

        Messages go out after the plant's first step, which already shows the effect of
        the commands. Clients need not wait while the remaining steps of the control
        period are computed.
        """
        for server in self._actions:
            server.advance(
                self._root.get_time(),
                self._value(port_of(server.robot, "arm.state_measured")),
                self._value(port_of(server.robot, "arm.position_commanded")),
            )
        for name, value in self._gate.admit(self.inbox.take(), self._context).items():
            self._station.GetInputPort(name).FixValue(self._context, value)
        time = min(self._root.get_time() + self._plant_step, until)
        self._advance_to(time)
        values = {name: self._value(name) for name in self._wanted}
        self.outlet.update(time, values)
        for topic in self._topics:
            if self.outlet.has_subscribers(topic.name):
                payload = [self._value(name) for name in topic.ports]
                self.outlet.send(topic, time, payload)
        self._pictures.look(time, self._plant_state, self.outlet)
        if time < until:  # CENIC takes no step of zero length
            self._advance_to(until)
        if self._replay is not None:
            self._replay.sample(self._root)

    def _advance_to(self, time: float) -> None:
        with failure_time(self._name, self._simulator):
            self._advance(time)

    def _plant_state(self) -> Vector:
        context = self._plant.GetMyContextFromRoot(self._root)
        return np.array(self._plant.get_state_output_port().Eval(context))

    def _value(self, name: str) -> Any:
        port = self._ports.get(name)
        return None if port is None else port.Eval(self._context)


_STATUS_PERIOD = 0.5  # time between status reports [s, real]

# Makes the bridges, given the inbox for their commands and the topics to publish.
Connect = Callable[[CommandInbox, Sequence[Topic]], Sequence[Bridge]]


@dc.dataclass(frozen=True)
class Served:
    """The result of serving a station."""

    sim_time: float  # s
    wall_time: float  # s
    commands: int  # messages received, valid or not
    recording: Path | None = None
    replay: Path | None = None


def Serve(
    scenario: Scenario,
    connect: Connect,
    *,
    name: str = "scenario",
    rate: float = 1.0,
    camera_period: float = PERIOD,
    out: Path | None = None,
    stop: threading.Event | None = None,
    tell: Callable[[str], None] = print,
    report: Callable[[str], None] = lambda _: None,
) -> Served:
    """Run a station under the commands of bridges until it is stopped.

    The scenario's task, planner, script and disturbances are ignored: the clients
    command the station. A scenario with a soft object has no camera topics. Pictures
    come from a process that imports the caller's main module, so a script needs
    `if __name__ == "__main__":`.

    Args:
        scenario: The scenario to serve.
        connect: Makes the bridges.
        name: The scenario's name, for messages.
        rate: Simulated seconds per real second; 0: as fast as possible, as in Drake.
        camera_period: Shortest time between pictures, except those of a visual servo's
            camera [s, simulated].
        out: Folder for recording.mcap and replay.html; None: record nothing.
        stop: Ends the run when set, by any thread or by a signal handler.
        tell: Called with warnings for the user, from any thread.
        report: Called with a status line at the start and twice a second.

    Raises:
        ScenarioError: If the models do not fit the scenario, a bridge needs ports that
            the station lacks, or Drake fails during the run. The recording is then
            complete up to the failure.
        OSError: If `out` cannot be written, or a bridge's address is in use.
        ValueError: If a bridge gets an invalid address.
        ImportError: If a bridge's packages are missing.
    """
    stop = stop or threading.Event()
    warnings = Warnings(tell)
    failure: ScenarioError | None = None
    recording: Path | None = None
    replay: ServedReplay | None = None
    with contextlib.ExitStack() as stack:
        builder, station = MakeRoot(
            "served_station", MakeServedStation, AddServedStation, scenario, name
        )
        with scenario_errors(name):
            stack.enter_context(output_folder(out))
            if out is not None:
                bag = AddRosbagRecorder(builder, station, scenario, out)
                recording = stack.enter_context(bag).path
            actions = MakeActionServers(scenario, station)
            requests = [topic for server in actions for topic in server.topics[0]]
            inbox = station_inbox(scenario, station, warnings, requests)
            topics = recorded_topics(station, scenario)
            root = builder.Build()
            simulator = MakeSimulator(root, scenario.simulator_config)
            simulator.set_target_realtime_rate(0.0)  # the Pacer sets the pace
            fix_defaults(station, my_context(station, simulator.get_mutable_context()))
            simulator.Initialize()
            advance = MakeAdvance(simulator, station, scenario)
            robots = robot_arms(scenario)
            if out is not None and robots[0].arm is not None:
                replay = ServedReplay(name, scenario, root, station)
        pictures = Pictures(scenario, warnings, camera_period)
        replies = [topic for server in actions for topic in server.topics[1]]
        published = [*topics, *pictures.topics.values(), *replies]
        outlet = Outlet(connect(inbox, published), warnings)
        for server in actions:
            server.connect(inbox, outlet)
        for bridge in outlet.bridges:
            stack.callback(bridge.close)
        stack.callback(pictures.close)
        _check_ports(name, outlet.bridges, station)
        start = wall.monotonic()
        loop = ServedLoop(
            name,
            simulator,
            advance,
            station,
            topics,
            pictures,
            inbox,
            outlet,
            replay,
            actions,
            robots,
        )
        try:
            with real_time_loop():
                _run(loop, control_period(scenario), name, rate, stop, report)
        except ScenarioError as error:
            failure = error
        elapsed = wall.monotonic() - start
    page = None if out is None or replay is None else replay.write(out)
    if failure is not None:
        raise failure
    time = simulator.get_context().get_time()
    return Served(time, elapsed, inbox.received, recording, page)


def _check_ports(name: str, bridges: Sequence[Bridge], station: Diagram) -> None:
    wanted = {port for bridge in bridges for port in bridge.ports}
    outputs = output_ports(station)
    missing = sorted(wanted - outputs.keys())
    if missing:
        raise ScenarioError(
            f"{name}: the station has no {', '.join(missing)}; "
            f"it has {', '.join(outputs)}"
        )


def _run(
    loop: ServedLoop,
    period: float,
    name: str,
    rate: float,
    stop: threading.Event,
    report: Callable[[str], None],
) -> None:
    """Advance one control period at a time until `stop` is set or no bridge is open."""
    pacer = Pacer(rate or math.inf, stop)
    bridges = loop.outlet.bridges
    step, reported = 0, -math.inf
    while not stop.is_set() and not all(bridge.closed for bridge in bridges):
        if wall.monotonic() - reported >= _STATUS_PERIOD:
            reported = wall.monotonic()
            report(
                f"{name}: {loop.outlet.status}; {step * period:.1f} s at "
                f"{pacer.factor:.2f} x real time, {loop.inbox.received} commands"
            )
        step += 1
        loop.advance(step * period)
        pacer.wait(step * period)
        if pacer.too_slow is not None:
            loop.inbox.warnings.warn(
                "pace",
                f"this machine cannot keep {rate:g} x real time with {name} (only "
                f"{pacer.too_slow:.2f} x): lower --rate or choose a faster scenario",
            )
