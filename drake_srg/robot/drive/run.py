"""A scenario's task on hardware: the cell, the control loop, and the recording."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import math
import threading
import time as wall
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import LinearSystem

from drake_srg.arm.driver import ArmDriver
from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.real_time import real_time_loop
from drake_srg.common.safety_states import SafetyState, StopReason, safety_state
from drake_srg.common.status_line import StatusLine
from drake_srg.common.systems import (
    export_outputs,
    input_ports,
    joint_unit,
    moving_joints,
    output_ports,
)
from drake_srg.lifetime import my_context
from drake_srg.planning.servoing.tracker import LateSightings
from drake_srg.planning.servoing.visual_servo import VisualServo
from drake_srg.recording.output import output_folder, write_log
from drake_srg.recording.timeline import draw_timeline, run_timeline
from drake_srg.robot.drive.config import HardwareConfig
from drake_srg.robot.drive.link import STAMP
from drake_srg.robot.drive.opening import Hardware, open_hardware
from drake_srg.robot.drive.planner_process import PlannerProcess
from drake_srg.robot.drive.remote_planner import PlannerLink, RemotePlanner
from drake_srg.robot.drive.station import MakeHardwareStation
from drake_srg.robot.serve.commands import (
    CommandInbox,
    PortValues,
    Warnings,
    port_of,
    safety_topics,
)
from drake_srg.robot.serve.connecting import KeyboardBridge
from drake_srg.robot.serve.loop import Pacer, control_period
from drake_srg.scenario import Scenario, robot_arms, servo_of
from drake_srg.simulation.metrics import Metrics, RunTimes, calc_metrics
from drake_srg.simulation.recorders import FILES, AddRosbagRecorder, run_labels
from drake_srg.simulation.run_log import RunLog
from drake_srg.simulation.simulate import Result, failure_time
from drake_srg.station.cell import command_ports
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.station.servoing import MakeServo
from drake_srg.types import Failure, Mode, PlannerStatus, Vector, mode_words

# Name endings of the outputs that our own monitors compute; all others are measured.
_OWN = ("safety.state", "safety.speed_scale", ".position_allowed", ".position_held")


def measurements(station: Diagram) -> dict[str, int]:
    """Return the sizes of a hardware station's measurements, by output port."""
    return {
        name: port.size()
        for name, port in output_ports(station).items()
        if not name.endswith(_OWN)
    }


def MakeHardwareCell(
    scenario: Scenario,
    station: Diagram,
    planner: PlannerLink,
    patience: float,
    lag: float = 0.0,
) -> Diagram:
    """Build the diagram of a hardware station and the planner that commands it.

    .. pydrake_system::

        name: HardwareCell
        input_ports:
        - safety.estop (optional)
        - safety.release (optional)
        - safety.speed_override (optional)
        output_ports:
        - ROOM.OUTPUT (all of the station's)
        - planner.mode
        - planner.status
        - arm.position_commanded
        - gripper.closure_commanded
        - planner.servo_status (with a visual servo)

    With `arms`, ports of an arm begin with `NAME.` as those of `MakeStation`. The
    subsystems are named `station` and `planner` and, with a visual servo, `servo`,
    `late_sightings` and `command_hold`. The servo moves the arm at the period of its
    driver. Sightings of its camera come from the planner.

    Args:
        scenario: The scenario to run on the hardware.
        station: A station from `MakeHardwareStation`, without cameras.
        planner: The connection to the planner.
        patience: Longest time for a plan [s].
        lag: Time within which the robot must reach a commanded position [s].
    """
    builder = DiagramBuilder()
    builder.AddNamedSystem("station", station)
    export_outputs(builder, station)
    for name, port in input_ports(station).items():
        if name.startswith("safety."):
            builder.ExportInput(port, name)
    sizes, robots = measurements(station), robot_arms(scenario)
    remote = builder.AddNamedSystem(
        "planner",
        RemotePlanner(
            planner,
            robots,
            sizes,
            control_period(scenario),
            scenario.planner.period,
            patience,
        ),
    )
    for name in sizes:
        builder.Connect(station.GetOutputPort(name), remote.GetInputPort(name))
    for robot in robots:
        for name in ("safety.state", "arm.position_held"):
            port = port_of(robot, name)
            builder.Connect(station.GetOutputPort(port), remote.GetInputPort(port))
    commanded = {
        port: remote.GetOutputPort(name) for name, port in command_ports(robots)
    }
    if servo_of(scenario) is not None:
        assert scenario.arm is not None
        servo = _AddServo(builder, scenario, station, remote, lag)
        hold = _AddHold(builder, scenario.arm, servo)
        commanded["arm.position_commanded"] = hold.get_output_port()
        builder.ExportOutput(servo.GetOutputPort("status"), "planner.servo_status")
    for name, output in commanded.items():
        builder.Connect(output, station.GetInputPort(name))
        builder.ExportOutput(output, name)
    for name in ("mode", "status"):
        builder.ExportOutput(remote.GetOutputPort(name), f"planner.{name}")
    diagram = builder.Build()
    diagram.set_name("hardware_cell")
    return diagram


def _AddServo(
    builder: DiagramBuilder,
    scenario: Scenario,
    station: Diagram,
    planner: RemotePlanner,
    lag: float,
) -> VisualServo:
    """Add a scenario's visual servo, and `late_sightings` in front of it."""
    assert scenario.arm is not None
    config, period = servo_of(scenario), scenario.arm.period
    assert config is not None
    # The safety monitor needs a new command every period, and `command_hold` delays
    # each by one period.
    config = dc.replace(config, period=period, lag=config.lag + lag + period)
    servo = builder.AddNamedSystem("servo", MakeServo(scenario, config))
    late = builder.AddNamedSystem(
        "late_sightings", LateSightings(len(scenario.arm.home), period)
    )
    for output, system, input in (
        (planner.GetOutputPort("sighting"), late, "sighting"),
        (station.GetOutputPort("arm.state_measured"), late, "arm_state"),
        (station.GetOutputPort(STAMP), late, "arm_stamp"),
        (planner.GetOutputPort("servo_command"), servo, "command"),
        (planner.GetOutputPort("position_commanded"), servo, "position_planned"),
        (station.GetOutputPort("arm.state_measured"), servo, "arm_state"),
        (late.get_output_port(), servo, "sighting"),
        (servo.GetOutputPort("status"), planner, "servo_status"),
    ):
        builder.Connect(output, system.GetInputPort(input))
    return servo


def _AddHold(
    builder: DiagramBuilder, arm: ArmDriver, servo: VisualServo
) -> LinearSystem:
    """Add `command_hold`, which delays a servo's commands by a period.

    At the same time, Drake updates the servo before the monitor, and other systems read
    the monitor before both. Without the delay, they would read outputs that belong to
    an older command than the monitor then judges.
    """
    eye = np.eye(len(arm.home))
    hold = builder.AddNamedSystem(
        "command_hold",
        LinearSystem(A=0.0 * eye, B=eye, C=eye, D=0.0 * eye, time_period=arm.period),
    )
    hold.configure_default_state(np.array(arm.home))
    builder.Connect(servo.GetOutputPort("position_commanded"), hold.get_input_port())
    return hold


# Time that a run continues after the task ended or the arm was stopped, so that the
# last commands arrive and are recorded [s].
_SETTLE = 0.5
_STOPPED = (SafetyState.PROTECTIVE_STOP, SafetyState.EMERGENCY_STOP)
_WHY = {
    StopReason.STALE: "nothing arrives from the robot any more",
    StopReason.FOLLOWING_ERROR: "the joints are not where they were sent",
    StopReason.MEASURED_SPEED: "a joint moves too fast",
    StopReason.EMERGENCY_STOP: "stopped by the user",
}


class ControlLoop:
    """Advances a cell one control period at a time, until the run has ended.

    Only `advance` touches the context, so one thread does all of the work. It never
    waits for the robot or the planner.

    A stop ends the run, unless the arm may wait for a release. In that case, the run
    continues once the user has released the stop and its cause is gone. A stop of one
    arm stops all arms.

    Args:
        diagram: The root diagram, which contains the cell.
        cell: A cell from `MakeHardwareCell`.
        release: How long a stopped arm waits for a release [s].

    Attributes:
        status: The planner's last report, or a report that the arm was stopped.
        period: The control period [s].
    """

    def __init__(
        self,
        name: str,
        scenario: Scenario,
        diagram: Diagram,
        cell: Diagram,
        release: float = 0.0,
    ) -> None:
        self.period = control_period(scenario)
        self.log = RunLog(scenario, cell)
        self.status = PlannerStatus()
        self._name, self._cell, self._simulator = name, cell, Simulator(diagram)
        self._root = self._simulator.get_mutable_context()
        self._context = my_context(cell, self._root)
        self._safety = {
            f"the arm {own.name}".rstrip(): cell.GetOutputPort(
                port_of(own, "safety.state")
            )
            for own in robot_arms(scenario)
        }
        self._status = cell.GetOutputPort("planner.status")
        self._sampling, self._next_sample = scenario.recording.period, 0.0
        self._steps, self._release = 0, release
        self._resting_since = math.inf  # stopped and at rest [s]
        self._pressed = False  # `press_estop` was called: the stop is final
        self._end: float | None = None  # when the run ends, once that is known [s]
        with failure_time(name, self._simulator):
            self._simulator.Initialize()

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return float(self._root.get_time())

    @property
    def safety(self) -> tuple[SafetyState, StopReason]:
        """State and reason of the safety monitor that decides; see `_decisive`."""
        return self._decisive()[1]

    def _decisive(self) -> tuple[str, tuple[SafetyState, StopReason]]:
        """Return the arm that decides, and its state.

        This is an arm that still moves, if there is one. Once all rest, it is the arm
        whose own stop caused the emergency stops of the others.
        """
        states = {
            arm: safety_state(port.Eval(self._context))
            for arm, port in self._safety.items()
        }

        def rests(arm: str) -> tuple[bool, bool]:
            state, reason = states[arm]
            return state in _STOPPED, reason is StopReason.EMERGENCY_STOP

        arm = min(states, key=rests)
        return arm, states[arm]

    @property
    def waits(self) -> str:
        """Reason of the stop while the arms wait for a release, otherwise ""."""
        state, reason = self.safety
        return reason.value if state in _STOPPED and self._end is None else ""

    def press_estop(self) -> None:
        """Stop the arms; the run ends once they rest."""
        self._pressed = True

    def _fix(self, values: PortValues) -> None:
        for name, value in values.items():
            self._cell.GetInputPort(name).FixValue(self._context, value)

    def advance(self, commands: PortValues | None = None) -> bool:
        """Advance by one period; return whether the run goes on.

        Args:
            commands: Commands to the safety monitor, by input port of the cell. A
                release lasts for this period only.

        Raises:
            ScenarioError: If Drake fails.
        """
        self._steps += 1
        commands = {"safety.release": np.zeros(1), **(commands or {})}
        if not self._release:  # a stop is final
            commands["safety.release"] = np.zeros(1)
        if self._pressed:
            commands["safety.estop"] = np.ones(1)
        with failure_time(self._name, self._simulator):
            # Commands change halfway between two updates. At the time of an update, a
            # command has already been sent, which the monitor would then contradict.
            self._simulator.AdvanceTo((self._steps - 0.5) * self.period)
            self._fix(commands)
            self._simulator.AdvanceTo(self._steps * self.period)
        if self.time >= self._next_sample - 1e-9:
            self._next_sample += self._sampling
            self.log.sample(self._context)
        self.status = self._status.Eval(self._context)
        arm, (state, reason) = self._decisive()
        resting = state in _STOPPED
        self._resting_since = (
            min(self._resting_since, self.time) if resting else math.inf
        )
        waited = self.time - self._resting_since
        if resting and (self._pressed or waited >= self._release):
            why = _WHY.get(reason, "a limit was reached")
            self.status = dc.replace(
                self.status,
                mode=Mode.FAILED,
                failure=Failure.STOPPED,
                message=f"{arm} was stopped ({reason.value}): {why}",
            )
        if self._end is None and self.status.ended:
            self._end = self.time + _SETTLE
        return self._end is None or self.time < self._end


# Largest distance of each joint from home at the start [rad or m].
_HOME = 0.05
# The control loop catches up with a delay of at most this [s].
_CATCH_UP = 0.02
# Topics that command the safety monitor.
_COMMANDS = ("estop", "release")
# Longest time for a plan, and between the first pictures and a ready planner [s].
_PLANNING = 60.0


def run_on_hardware(
    scenario: Scenario,
    config: HardwareConfig,
    *,
    name: str = "scenario",
    out: Path | None = None,
    record: bool = True,
    progress: bool = False,
    stop: threading.Event | None = None,
    tell: Callable[[str], None] = print,
    terminal: int | None = None,
) -> Result:
    """Do a scenario's task on hardware, in real time.

    The control loop (measurements, safety monitor, commands) and the planner run in two
    processes; see `planner_process`. The files are those of `Simulate`, without video
    and replay. There is no ground truth about the objects: `metrics.claimed` says
    whether the planner reports success.

    A safety stop ends the run, unless the hardware file lets it wait for a release.
    Topics (/estop, /release) and keys (e, r) command the monitor. The scenario's
    disturbances do not happen.

    Args:
        scenario: The scenario to run.
        config: The drivers.
        name: The scenario's name, for metrics.json and messages.
        out: Folder for the results; None: write nothing.
        record: Whether to write rosbag and timeline too.
        progress: Whether to show progress on standard error.
        stop: Stops the arm when set, by any thread or by a signal handler.
        tell: Called with warnings for the user, from any thread.
        terminal: Descriptor of a terminal whose keys are commands; None: no keys.

    Raises:
        ScenarioError: If the scenario does not fit the hardware, the arm is not at
            home, or nothing arrives at the start.
        OSError: If `out` cannot be written, or an address is in use.
        ImportError: If a driver's packages are missing.
    """
    stop = stop or threading.Event()
    warnings = Warnings(tell)
    scenario = dc.replace(scenario, disturbances=[])
    inbox = CommandInbox(safety_topics(["safety.estop"], _COMMANDS), warnings)
    with contextlib.ExitStack() as stack:
        stack.enter_context(output_folder(out))
        if out is not None:
            for file in (*FILES.values(), "metrics.json"):
                (out / file).unlink(missing_ok=True)
        with scenario_errors(name):
            hardware = stack.enter_context(
                open_hardware(
                    scenario, config, warnings, inbox=inbox, stopped=stop.is_set
                )
            )
            _check_home(scenario, hardware)
            check_servo(scenario, config, hardware)
            if scenario.arms and config.release:
                raise ScenarioError(
                    "release: must be 0 with several arms, where a stop is final"
                )
            station = MakeHardwareStation(scenario, hardware)
            planner = stack.enter_context(
                contextlib.closing(
                    PlannerProcess(
                        scenario,
                        config,
                        measurements(station),
                        hardware.start,
                        warnings,
                    )
                )
            )
            builder = DiagramBuilder()
            cell = builder.AddNamedSystem(
                "cell",
                MakeHardwareCell(scenario, station, planner, _PLANNING, hardware.lag),
            )
            if out is not None and record:
                stack.enter_context(AddRosbagRecorder(builder, cell, scenario, out))
            loop = ControlLoop(name, scenario, builder.Build(), cell, config.release)
            planner.wait(_PLANNING + config.patience, stop.is_set)
            if terminal is not None:
                keys = KeyboardBridge(inbox, terminal)
                stack.callback(keys.close)
        try:
            with real_time_loop():
                elapsed = _run(loop, inbox, name, config.rate, stop, progress)
        finally:
            log = loop.log.arrays() if loop.log else {}
            written = _write(out, log, scenario, name, record)
    times = RunTimes(loop.time, elapsed, planner.planning_wall)
    metrics = _metrics(scenario, name, loop, log, times, written)
    if out is not None:
        metrics.write(out / "metrics.json")
    return Result(metrics, log, loop.status)


def _check_home(scenario: Scenario, hardware: Hardware) -> None:
    """Raise a ScenarioError unless the arms are at home, where the planner begins."""
    for own in robot_arms(scenario):
        assert own.arm is not None
        home = np.array(own.arm.home)
        state = hardware.start[port_of(own, "arm.state_measured")]
        away = np.abs(state[: len(home)] - home)
        if away.max() > _HOME:
            worst = int(np.argmax(away))
            plant = MakeModelsPlant(scenario)
            model = plant.GetModelInstanceByName(own.arm_model)
            unit = joint_unit(moving_joints(plant, model)[worst])
            raise ScenarioError(
                f"{own.key}arm.home: the arm must start there, but joint {worst + 1} "
                f"is {away[worst]:.3f} {unit} away "
                f"(allowed: {_HOME})"
            )


def check_servo(scenario: Scenario, config: HardwareConfig, hardware: Hardware) -> None:
    """Raise a ScenarioError if a visual servo cannot work."""
    if servo_of(scenario) is None:
        return
    if config.release:
        raise ScenarioError(
            "release: must be 0 with planner: !Servoing, where a stop is final"
        )
    if STAMP not in hardware.start:
        raise ScenarioError(
            "planner: !Servoing needs an arm whose states have time stamps "
            "(allowed: !Ros1Arm, !Ros2Arm)"
        )


def _run(
    loop: ControlLoop,
    inbox: CommandInbox,
    name: str,
    rate: float,
    stop: threading.Event,
    progress: bool,
) -> float:
    """Advance in real time until the run has ended; return how long it took [s]."""
    start = wall.monotonic()
    never = threading.Event()  # never set: the pacer also paces a stop
    pacer = Pacer(rate, never, patience=_CATCH_UP)
    goes_on = True
    with StatusLine(shown=progress) as line:
        while goes_on:
            if stop.is_set():
                loop.press_estop()
            goes_on = loop.advance(inbox.take())
            if goes_on and loop.waits:
                inbox.warnings.warn(
                    "stop",
                    f"the arm is stopped ({loop.waits}); it waits for a /release, or "
                    "the key r",
                )
            else:
                inbox.warnings.forget("stop")
            mode = mode_words(loop.status.mode)
            line.show(f"{name}: {loop.time:6.2f} s, {mode}", last=not goes_on)
            pacer.wait(loop.time)
    if pacer.lost > 0.0:
        inbox.warnings.warn(
            "lost", f"the control loop was held up for {pacer.lost:.2f} s"
        )
    return wall.monotonic() - start


def _write(
    out: Path | None,
    log: Mapping[str, Vector],
    scenario: Scenario,
    name: str,
    record: bool,
) -> dict[str, str]:
    """Write log and timeline; return paths by kind."""
    if out is None or not log:
        return {}
    written = {"log": str(write_log(out / FILES["log"], log))}
    if record:
        timeline = run_timeline(log, run_labels(name, scenario))
        written["timeline"] = str(draw_timeline(timeline, out / FILES["timeline"]))
        written["recording"] = str(out / FILES["recording"])
    return written


def _metrics(
    scenario: Scenario,
    name: str,
    loop: ControlLoop,
    log: Mapping[str, Vector],
    times: RunTimes,
    written: Mapping[str, str],
) -> Metrics:
    """Return the metrics that need no ground truth."""
    status = loop.status
    metrics = calc_metrics(
        scenario,
        name,
        log,
        status,
        set(),
        times,
        {kind: written.get(kind) for kind in FILES},
    )
    return dc.replace(
        metrics,
        success=False,
        claimed=status.done,
        failure=None if status.failure is None else status.failure.value,
    )
