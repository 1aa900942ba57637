"""The hardware station: the ports of a station, connected to a real robot."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import (
    BasicVector,
    Context,
    Diagram,
    DiagramBuilder,
    DiscreteValues,
    OutputPort,
)
from pydrake.systems.primitives import ConstantVectorSource

from drake_srg.arm.safety.config import SafetyConfig
from drake_srg.arm.safety.monitor import AddSafetyMonitor, SafetyMonitor
from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.safety_states import SafetyState, safety_state
from drake_srg.common.systems import input_ports, output_ports
from drake_srg.gripper.driver import GraspDetector
from drake_srg.lifetime import LeafSystem, weak
from drake_srg.robot.drive.cameras import CameraFeed
from drake_srg.robot.drive.link import COMMANDS, EXTERNAL_TORQUE, STAMP, Link
from drake_srg.robot.drive.opening import Hardware
from drake_srg.robot.serve.commands import PortValues, port_of
from drake_srg.robot.serve.loop import control_period
from drake_srg.scenario import RobotArm, Scenario, perception_cameras, robot_arms
from drake_srg.station.plant import MakeModelsPlant


class HardwareReader(LeafSystem):
    """Outputs the newest measurements of links, and when they last arrived.

    .. pydrake_system::

        name: HardwareReader
        output_ports:
        - ROOM.MEASUREMENT (each of the links)
        - heartbeat
        - hardware.stamp

    Every `period`, it takes new measurements from the links; the other outputs keep
    their values. `heartbeat` (1) is the time [s] of the last delivery of the link that
    has been silent for longest. `hardware.stamp` (1) is the newest time by the robot's
    clock [s].

    Args:
        period: Time between readings [s].
        start: Values before anything arrives, by port; those of other ports are NaN.
    """

    def __init__(
        self, links: Sequence[Link], period: float, start: PortValues | None = None
    ) -> None:
        super().__init__()
        self._links = list(links)
        start = start or {}
        sizes = {name: n for link in links for name, n in link.outputs.items()}
        self._states = {}
        for name, size in {**sizes, STAMP: 1}.items():
            value = start.get(name, np.full(size, np.nan))
            index = self.DeclareDiscreteState(value)
            self.DeclareStateOutputPort(name, index)
            self._states[name] = int(index)
        # When each link last delivered [s]; all did before the station was built.
        self._heard = int(self.DeclareDiscreteState(np.zeros(len(self._links))))
        self.DeclareVectorOutputPort(
            name="heartbeat",
            size=1,
            calc=self._calc_heartbeat,
            prerequisites_of_calc={self.xd_ticket()},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update
        )

    def _calc_heartbeat(self, context: Context, output: BasicVector) -> None:
        output[0] = np.min(context.get_discrete_state(self._heard).value())

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        for i, link in enumerate(self._links):
            values = link.take()
            for name, value in values.items():
                index = self._states[name]
                # Links of several arms may report the robot's time; the newest counts.
                older = discrete_state.value(index) if name == STAMP else value
                discrete_state.set_value(index, np.fmax(value, older))
            if values:
                heard = discrete_state.get_mutable_value(self._heard)
                heard[i] = context.get_time()


class HardwareWriter(LeafSystem):
    """Sends commands to links.

    .. pydrake_system::

        name: HardwareWriter
        input_ports:
        - ROOM.COMMAND (each command)

    Args:
        links: The links; each gets all commands.
        period: Time between commands [s].
        sizes: Sizes of the commands, by name.
    """

    def __init__(
        self, links: Sequence[Link], period: float, sizes: Mapping[str, int]
    ) -> None:
        super().__init__()
        self._links, self._names = list(links), list(sizes)
        for name, size in sizes.items():
            self.DeclareVectorInputPort(name=name, size=size)
        self.DeclarePeriodicPublishEvent(period, 0.0, self._send)

    def _send(self, context: Context) -> None:
        values = {name: self.GetInputPort(name).Eval(context) for name in self._names}
        for link in self._links:
            link.send(values)


class CommonStop(LeafSystem):
    """Stops all arms once one of them is stopped.

    .. pydrake_system::

        name: CommonStop
        input_ports:
        - estop (optional)
        - safety.state (of each arm)
        output_ports:
        - safety.estop (of each arm)

    `estop` (1) is nonzero while the button is pressed, `safety.state` (2) that of an
    arm's `SafetyMonitor`. An arm's `safety.estop` (1) is nonzero while the button is
    pressed, or while the arm runs and another one is stopped. Ports of an arm with a
    name begin with `NAME.`.
    """

    def __init__(self, robots: Sequence[RobotArm]) -> None:
        super().__init__()
        self._estop = self.DeclareVectorInputPort(name="estop", size=1)
        self._states = {
            robot.name: self.DeclareVectorInputPort(port_of(robot, "safety.state"), 2)
            for robot in robots
        }
        for robot in robots:
            self.DeclareVectorOutputPort(
                name=port_of(robot, "safety.estop"),
                size=1,
                calc=functools.partial(weak(self._calc_estop), robot.name),
                prerequisites_of_calc={self.all_input_ports_ticket()},
            )

    def _calc_estop(self, arm: str, context: Context, output: BasicVector) -> None:
        pressed = self._estop.HasValue(context)
        output[0] = self._estop.Eval(context)[0] if pressed else 0.0
        runs = {
            name: safety_state(port.Eval(context))[0] is SafetyState.RUNNING
            for name, port in self._states.items()
        }
        if runs[arm] and not all(runs.values()):
            output[0] = 1.0


class HandHold(LeafSystem):
    """Freezes a gripper's command while the arm is stopped, and tells it to hold.

    .. pydrake_system::

        name: HandHold
        input_ports:
        - closure_commanded
        - safety_state
        output_ports:
        - closure_allowed
        - hold

    `closure_commanded` (1) is 0 open .. 1 closed, `safety_state` (2) that of a
    `SafetyMonitor`. While the arm runs, the command passes. Otherwise `closure_allowed`
    (1) is the last command before the stop, and `hold` (1) is 1: the gripper must stay
    where it is and keep its grip.

    Args:
        period: The control period [s].
    """

    def __init__(self, period: float) -> None:
        super().__init__()
        self._commanded = self.DeclareVectorInputPort(name="closure_commanded", size=1)
        self._safety = self.DeclareVectorInputPort(name="safety_state", size=2)
        self._kept = int(self.DeclareDiscreteState(np.zeros(1)))
        self.DeclareVectorOutputPort(
            name="closure_allowed", size=1, calc=self._calc_closure
        )
        self.DeclareVectorOutputPort(
            name="hold",
            size=1,
            calc=self._calc_hold,
            prerequisites_of_calc={self._safety.ticket()},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _runs(self, context: Context) -> bool:
        state, _ = safety_state(self._safety.Eval(context))
        return state is SafetyState.RUNNING

    def _calc_closure(self, context: Context, output: BasicVector) -> None:
        if self._runs(context):
            output.SetFromVector(self._commanded.Eval(context))
        else:
            output.SetFromVector(context.get_discrete_state(self._kept).value())

    def _calc_hold(self, context: Context, output: BasicVector) -> None:
        output[0] = 0.0 if self._runs(context) else 1.0

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        if self._runs(context):
            discrete_state.set_value(self._kept, self._commanded.Eval(context))


_TRIGGERED = "gripper.triggered"


@scenario_errors()
def MakeHardwareStation(scenario: Scenario, hardware: Hardware) -> Diagram:
    """Build the station of a real robot: `MakeStation`'s ports, except for a plant's.

    .. pydrake_system::

        name: HardwareStation
        input_ports:
        - arm.position_commanded
        - gripper.closure_commanded
        - safety.estop (optional)
        - safety.release (optional)
        - safety.speed_override (optional)
        output_ports:
        - arm.MEASUREMENT (each of the arm's link)
        - gripper.MEASUREMENT (each of the gripper's link)
        - gripper.grasped (with finger sensors)
        - hardware.stamp
        - arm.position_allowed
        - arm.position_held
        - safety.state
        - safety.speed_scale
        - camera_NAME.color_image (with cameras)
        - camera_NAME.depth_image (with cameras)
        - camera_NAME.body_pose_in_world (with cameras)

    A `SafetyMonitor` stands between the commands and the robot, even if the scenario
    has no `safety`: it stops the arm when a link falls silent. A `HandHold` halts the
    gripper while the arm is stopped. With `arms`, ports of an arm begin with `NAME.` as
    those of `MakeStation`. All monitors share the inputs `safety.estop`,
    `safety.release` and `safety.speed_override`, and a `CommonStop` stops all arms once
    one is stopped. Advance the station in real time, in steps of at most `arm.period`.
    No system waits for the robot, except that cameras wait for a picture when their
    images are evaluated.

    Args:
        scenario: The scenario to run on the hardware.
        hardware: The connections; they must stay open.

    Raises:
        ScenarioError: If the models or limits do not fit the scenario.
    """
    builder = DiagramBuilder()
    AddHardwareStation(builder, scenario, hardware)
    diagram = builder.Build()
    diagram.set_name("hardware_station")
    return diagram


def AddHardwareStation(
    builder: DiagramBuilder,
    scenario: Scenario,
    hardware: Hardware,
    unmonitored: float | None = None,
) -> None:
    """Add the systems of `MakeHardwareStation` to a diagram, and export their ports.

    Args:
        builder: The diagram's builder.
        scenario: The scenario to run on the hardware.
        hardware: The connections.
        unmonitored: None: add monitors. Otherwise, monitors stand elsewhere on the way
            to the robot, and this is the period of readings and commands [s].

    Raises:
        ScenarioError: If the models or limits do not fit the scenario.
    """
    robots, links = robot_arms(scenario), hardware.links
    period = unmonitored or control_period(scenario)
    _check_touch(scenario, links, monitored=unmonitored is None)
    reader = builder.AddNamedSystem(
        "hardware_reader", HardwareReader(links, period, hardware.start)
    )
    sizes = {
        port_of(robot, name): len(robot.arm.home) if name.startswith("arm.") else 1
        for robot in robots
        for name in COMMANDS
        if robot.arm is not None
    }
    writer = builder.AddNamedSystem(
        "hardware_writer", HardwareWriter(links, period, sizes)
    )
    triggered = {port_of(robot, _TRIGGERED): robot for robot in robots}
    for name, output in output_ports(reader).items():
        if name not in ("heartbeat", *triggered):
            builder.ExportOutput(output, name)
    for name, robot in triggered.items():
        if reader.HasOutputPort(name):
            _AddDetector(builder, reader.GetOutputPort(name), robot)
    if unmonitored is None:
        _AddMonitors(builder, scenario, reader, writer, hardware.lag)
    else:
        never = builder.AddNamedSystem("never", ConstantVectorSource([0.0]))
        holds = [port_of(robot, "gripper.hold") for robot in robots]
        for name, port in input_ports(writer).items():
            if name in holds:
                builder.Connect(never.get_output_port(), port)
            else:
                builder.ExportInput(port, name)
    for name, camera in hardware.cameras.items():
        if name not in perception_cameras(scenario):
            continue  # only a visual servo uses it
        feed = builder.AddNamedSystem(
            f"camera_{name}", CameraFeed(camera, camera_pose(scenario, name))
        )
        builder.Connect(reader.GetOutputPort(STAMP), feed.get_input_port())
        for image, output in output_ports(feed).items():
            builder.ExportOutput(output, f"camera_{name}.{image}")


def _check_touch(scenario: Scenario, links: Sequence[Link], *, monitored: bool) -> None:
    """Raise a ScenarioError if needed external torques are not measured."""
    for robot in robot_arms(scenario):
        safety = robot.safety if monitored else None
        felt = scenario.planner.feels or (safety is not None and safety.feels)
        torque = port_of(robot, EXTERNAL_TORQUE)
        if felt and not any(torque in link.outputs for link in links):
            raise ScenarioError(
                f"hardware: {robot.key}arm: does not tell external torques, which "
                "safety.external_torque, safety.force, planner.max_external_torque and "
                "planner: !Handover need (allowed: !Ros1Arm and !Ros2Arm with "
                "`external_torque`, the name of a topic)"
            )


def _AddDetector(
    builder: DiagramBuilder, triggered: OutputPort, robot: RobotArm
) -> None:
    """Add the system that detects a grasp, and export its port."""
    assert robot.gripper is not None
    fingers, config = robot.gripper.layout.fingers, robot.gripper.grasp_detector
    name = robot.system("grasp_detector")
    detector = builder.AddNamedSystem(name, GraspDetector(fingers, config))
    builder.Connect(triggered, detector.get_input_port())
    grasped = port_of(robot, "gripper.grasped")
    builder.ExportOutput(detector.get_output_port(), grasped)


def _AddMonitors(
    builder: DiagramBuilder,
    scenario: Scenario,
    reader: HardwareReader,
    writer: HardwareWriter,
    lag: float,
) -> None:
    """Add the systems between the commands and the writer, and export their ports."""
    robots, plant = robot_arms(scenario), MakeModelsPlant(scenario)
    stop = builder.AddNamedSystem("common_stop", CommonStop(robots))
    monitors = []
    for robot in robots:
        with robot.named_errors():
            monitor = _AddMonitor(builder, plant, robot, reader, writer, lag)
        state, estop = port_of(robot, "safety.state"), port_of(robot, "safety.estop")
        builder.Connect(monitor.GetOutputPort("state"), stop.GetInputPort(state))
        builder.Connect(stop.GetOutputPort(estop), monitor.GetInputPort("estop"))
        monitors.append(monitor)
    builder.ExportInput(stop.GetInputPort("estop"), "safety.estop")
    for name in ("release", "speed_override"):
        first, *others = (monitor.GetInputPort(name) for monitor in monitors)
        builder.ExportInput(first, f"safety.{name}")
        for other in others:
            builder.ConnectInput(f"safety.{name}", other)


def _AddMonitor(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    robot: RobotArm,
    reader: HardwareReader,
    writer: HardwareWriter,
    lag: float,
) -> SafetyMonitor:
    """Add an arm's monitor and its gripper's hold, and export the ports of both."""
    arm, own = robot.arm, functools.partial(port_of, robot)
    assert arm is not None
    monitor = AddSafetyMonitor(
        builder,
        plant,
        arm.home,
        _lenient(robot.safety or SafetyConfig(), plant, robot, lag),
        arm.period,
        arm=robot.arm_model,
        name=robot.system("safety_monitor"),
    )
    name = robot.system("hand_hold")
    hand = builder.AddNamedSystem(name, HandHold(arm.period))
    position, closure, hold = map(own, COMMANDS)
    for output, system, input in (
        (reader.GetOutputPort(own("arm.state_measured")), monitor, "state_measured"),
        (reader.GetOutputPort("heartbeat"), monitor, "heartbeat"),
        (monitor.GetOutputPort("state"), hand, "safety_state"),
        (monitor.GetOutputPort("position_allowed"), writer, position),
        (hand.GetOutputPort("closure_allowed"), writer, closure),
        (hand.GetOutputPort("hold"), writer, hold),
    ):
        builder.Connect(output, system.GetInputPort(input))
    builder.ExportInput(monitor.GetInputPort("position_commanded"), position)
    builder.ExportInput(hand.GetInputPort("closure_commanded"), closure)
    torque = own(EXTERNAL_TORQUE)
    if reader.HasOutputPort(torque):
        builder.Connect(
            reader.GetOutputPort(torque), monitor.GetInputPort("external_torque")
        )
    for name, room in (
        ("position_allowed", "arm"),
        ("position_held", "arm"),
        ("state", "safety"),
        ("speed_scale", "safety"),
    ):
        builder.ExportOutput(monitor.GetOutputPort(name), own(f"{room}.{name}"))
    return monitor


def _lenient(
    safety: SafetyConfig, plant: MultibodyPlant, robot: RobotArm, lag: float
) -> SafetyConfig:
    """Return limits that tolerate joints that follow their commands with a lag [s]."""
    if safety.following_error is None:
        return safety
    arm = plant.GetModelInstanceByName(robot.arm_model)
    speeds = plant.GetVelocitiesFromArray(arm, plant.GetVelocityUpperLimits())
    return dc.replace(
        safety, following_error=safety.following_error + lag * float(np.max(speeds))
    )


def camera_pose(scenario: Scenario, name: str) -> RigidTransform:
    """Return the pose of a camera's body in world, calibrated if possible [m].

    Raises:
        ScenarioError: If the camera is not fixed to the world.
    """
    calibration = scenario.camera_calibrations.get(name)
    pose = (calibration or scenario.cameras[name]).X_PB
    if pose.base_frame not in (None, "", "world"):
        raise ScenarioError(
            f"cameras.{name}.X_PB.base_frame: must be world on hardware, "
            f"got {pose.base_frame}"
        )
    X_WB: RigidTransform = pose.GetDeterministicValue()
    return X_WB
