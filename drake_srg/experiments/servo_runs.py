"""Pick-and-place runs of our planner over a servo bus."""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Sequence

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_srg.arm.safety.config import SafetyConfig
from drake_srg.common.safety_states import SafetyState, safety_state
from drake_srg.experiments.servo_robot import DirectLine, ServoRobot, SimulatedCamera
from drake_srg.planning.servoing.hand_motion import ServoArm
from drake_srg.robot.drive.config import FaultsConfig, FaultyLink
from drake_srg.robot.drive.dynamixel.bus import ServoBus
from drake_srg.robot.drive.dynamixel.drivers import (
    BusCycle,
    DynamixelArm,
    DynamixelGripper,
)
from drake_srg.robot.drive.link import Link, Nodes, Robot
from drake_srg.robot.drive.opening import Hardware
from drake_srg.robot.drive.station import AddHardwareStation
from drake_srg.robot.serve.commands import Warnings
from drake_srg.robot.serve.connecting import Ros1Config, Ros2Config
from drake_srg.robot.serve.dynamixel.servo import JOINT
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.station import MakeCell
from drake_srg.station.planners import final_pose, final_tilt
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Mode, Vector

_PORT = "tcp:127.0.0.1:1"  # a name only: nothing connects there
_SETTLE = 0.5  # after the planner has ended [s]
_TRIES = 10  # exchanges before the start, which measurements may take to arrive
_MAX_TILT = np.deg2rad(5.0)


@dc.dataclass(frozen=True)
class Wire:
    """What is on the way between planner and servos.

    Attributes:
        protocol: Dynamixel protocol.
        latency: Of measurements, and of commands [s].
        loss: Share of the packets that lose a byte.
        reboot: When a servo of the arm reboots [s], after the start; None: never.
        silence: How long the bus is silent meanwhile [s].
    """

    protocol: int = 1
    latency: float = 0.0
    loss: float = 0.0
    reboot: float | None = None
    silence: float = 0.0


@dc.dataclass(frozen=True)
class Run:
    """The outcome of a run.

    Attributes:
        claimed: Whether the planner says that it is done.
        placed: Whether the object is where it must be.
        stopped: Why the safety monitor stopped the arm; empty if it did not.
        reason: The planner's failure; empty without one.
        error: Largest of the placement errors in x and y [m].
        rounding: By how much whole counts of the joints may move the object in x or y
            where it is let go [m]; NaN: it was not.
        told: Warnings.
    """

    claimed: bool
    placed: bool
    stopped: str
    reason: str
    error: float
    rounding: float
    told: list[str]


def run_over_servos(
    name: str, seed: int, wire: Wire, overrides: Sequence[str] = ()
) -> Run:
    """Run a scenario's task, with everything but pictures over a servo bus.

    Args:
        name: Of a scenario with an arm of bus servos.
        seed: Of the scenario, and of the losses.
        wire: What is on the way.
        overrides: Of the scenario, `KEY=VALUE` each.
    """
    scenario = load_scenario(name, seed=seed, overrides=overrides)
    arm = scenario.arm
    assert arm is not None
    told: list[str] = []
    robot = ServoRobot(scenario, wire.protocol, Warnings(told.append))
    start = robot.pose()
    line = DirectLine(robot, wire.loss, seed)
    cycle, hardware = _connect(scenario, robot, line, wire, Warnings(told.append))
    safety = scenario.safety or SafetyConfig()

    def make_station(scenario: Scenario) -> Diagram:
        builder = DiagramBuilder()
        AddHardwareStation(builder, scenario, hardware, safety)
        return builder.Build()

    cell = MakeCell(scenario, make_station)
    simulator = Simulator(cell)
    simulator.Initialize()
    context = simulator.get_context()
    status = cell.GetOutputPort("planner.status")
    state = cell.GetOutputPort("safety.state")
    end, stopped, counts = scenario.planner.time_budget, "", math.nan
    reboot = math.inf if wire.reboot is None else wire.reboot
    while robot.time < end and not stopped:
        time = robot.time + arm.period
        if robot.time < reboot <= time:
            robot.bus.servos[2].reboot()
        line.silent = reboot <= time < reboot + wire.silence
        cycle.cycle()
        simulator.AdvanceTo(time)
        robot.advance(time)
        doing, why = safety_state(state.Eval(context))
        if doing in (SafetyState.PROTECTIVE_STOP, SafetyState.EMERGENCY_STOP):
            stopped = why.value
        mode = status.Eval(context).mode
        if mode is Mode.RELEASE and math.isnan(counts):
            q = robot.arm_position()[: len(arm.home)]
            counts = rounding(scenario, q, robot.pose().translation())
        if mode in (Mode.DONE, Mode.FAILED):
            end = min(end, time + _SETTLE)
    for link in hardware.links:
        link.close()
    final, report = robot.pose(), status.Eval(context)
    goal = final_pose(scenario, start)
    error = final.translation() - goal.translation()
    tilt = final_tilt(scenario, start, final)
    near = bool(np.linalg.norm(error) <= scenario.task.place.tolerance)
    return Run(
        report.mode is Mode.DONE,
        near and (tilt is None or bool(tilt <= _MAX_TILT)),
        stopped,
        report.failure.value if report.failure else "",
        float(np.max(np.abs(error[:2]))),
        counts,
        told,
    )


def rounding(scenario: Scenario, q: Vector, p_WO: Vector) -> float:
    """Return how far half a count of every joint moves a held object in x or y [m].

    Args:
        scenario: With an arm of N joints.
        q: Their positions, shape (N,) [rad].
        p_WO: The object's, shape (3,) [m].
    """
    arm = ServoArm(MakeModelsPlant(scenario))
    p_GO_W = p_WO - arm.X_WG(q).translation()
    v, w = np.split(arm.jacobian(q), 2)
    of_object = v + np.cross(w, p_GO_W, axis=0)
    half = 0.5 * abs(JOINT.to_angle(1) - JOINT.to_angle(0))
    return float(half * np.max(np.sum(np.abs(of_object[:2]), axis=1)))


def _connect(
    scenario: Scenario,
    robot: ServoRobot,
    line: DirectLine,
    wire: Wire,
    warnings: Warnings,
) -> tuple[BusCycle, Hardware]:
    """Return the exchange with a robot's servos, and the links to them."""
    arm, gripper = scenario.arm, scenario.gripper
    assert arm is not None
    assert gripper is not None
    travel, _ = gripper.empty_hand(1.0)
    cycle = BusCycle(lambda: ServoBus(line, wire.protocol), warnings)
    plant = MakeModelsPlant(scenario)
    n = len(arm.home)
    names = tuple(f"joint_{k + 1}" for k in range(n))
    limits = (
        np.array(plant.GetPositionLowerLimits()[:n]),
        np.array(plant.GetPositionUpperLimits()[:n]),
    )
    nodes = Nodes(Ros1Config(), Ros2Config(), warnings)
    parts = Robot(scenario, names, limits, warnings, nodes)
    drivers = (
        DynamixelArm(port=_PORT, protocol=wire.protocol),
        DynamixelGripper(
            port=_PORT,
            protocol=wire.protocol,
            id=n + 1,
            open=JOINT.zero,
            closed=round(JOINT.to_counts(-travel)),
        ),
    )
    links: list[Link] = []
    for driver in drivers:
        driver.share(parts, cycle)
        link = driver.connect(parts)
        if wire.latency:
            link = FaultyLink(link, FaultsConfig(latency=wire.latency), arm.period)
        links.append(link)
    found: dict[str, Vector] = {}
    for _ in range(_TRIES):  # the first sets the servos up where they are
        cycle.cycle()
        for link in links:
            found |= link.take()
    cameras = {
        name: SimulatedCamera(robot, name) for name in scenario.localizer.cameras
    }
    return cycle, Hardware(links, cameras, found)
