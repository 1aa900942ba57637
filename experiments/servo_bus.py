"""The five-axis arm's task by our planner over a bus of emulated servos.

Only packets of the Dynamixel protocols command and measure joints and gripper. The
planner therefore has no distance sensors, and joint angles in counts of 0.088 degrees.
Images come directly from the simulated camera. Both sides advance in turn, so no result
depends on the machine's speed. The placement error may be twice as large as without a
bus, plus the rounding of the joints to counts.
"""

import dataclasses as dc
import math
from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

import experiments.runner as ex
from drake_srg import MakeCell, MakeStation, Scenario, load_scenario
from drake_srg.common.safety_states import SafetyState, safety_state
from drake_srg.common.systems import MakeSimulator
from drake_srg.planning.servoing.hand_motion import ServoArm
from drake_srg.robot.drive.cameras import Camera, Picture
from drake_srg.robot.drive.config import FaultsConfig, FaultyLink, HardwareConfig
from drake_srg.robot.drive.dynamixel import drivers
from drake_srg.robot.drive.dynamixel.bus import ServoBus
from drake_srg.robot.drive.link import Link
from drake_srg.robot.drive.opening import Hardware, MakeRobot
from drake_srg.robot.drive.station import MakeHardwareStation
from drake_srg.robot.serve.commands import CommandInbox, Warnings
from drake_srg.robot.serve.dynamixel.bridge import EmulatedBus, station_mechanisms
from drake_srg.robot.serve.dynamixel.mx64 import Mx64, Mx64P2
from drake_srg.robot.serve.dynamixel.protocol import PacketReader
from drake_srg.robot.serve.dynamixel.servo import JOINT
from drake_srg.robot.serve.loop import AddServedStation
from drake_srg.station.planners import final_pose, final_tilt
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Mode, Vector
from experiments.stands.cycles import run_cycle

_SCENARIO = "assistive_arm"
_WITHOUT = "without a bus"
_SETTLE = 0.5  # after the planner has ended [s]
_TRIES = 10  # exchanges within which the first measurements must arrive
_MAX_TILT = np.deg2rad(5.0)


@dc.dataclass(frozen=True)
class Wire:
    """The components between planner and servos."""

    protocol: int = 1  # of Dynamixel
    latency: float = 0.0  # of measurements, and of commands [s]
    loss: float = 0.0  # share of the packets that lose a byte
    reboot: float = math.inf  # when a servo of the arm reboots, after the start [s]
    silence: float = 0.0  # how long the bus is silent meanwhile [s]


WIRES = {
    "Protocol 1.0": Wire(),
    "Protocol 2.0": Wire(protocol=2),
    "20 ms each way": Wire(latency=0.02),
    "5 % damaged": Wire(loss=0.05),
    "servo reboots": Wire(reboot=3.0),
    "reboot, 0.2 s silent": Wire(reboot=3.0, silence=0.2),
}
_CLEAN = ("Protocol 1.0", "Protocol 2.0")


class ServoRobot:
    """A served station whose clients are the masters of its servos, `bus`."""

    def __init__(self, scenario: Scenario, protocol: int, warnings: Warnings) -> None:
        builder = DiagramBuilder()
        AddServedStation(builder, scenario, lambda _: MakeStation(scenario))
        self._station = builder.Build()
        self._simulator = MakeSimulator(self._station, scenario.simulator_config)
        self._context = self._simulator.get_mutable_context()
        fix = self._station.GetInputPort
        fix("gripper.closure_commanded").FixValue(self._context, np.zeros(1))
        self._simulator.Initialize()
        self._inbox = CommandInbox([], warnings)
        firmware = Mx64 if protocol == 1 else Mx64P2
        mechanisms = station_mechanisms(scenario)
        self.bus = EmulatedBus(self._inbox, mechanisms, firmware, warnings.warn)
        self._pick = scenario.task.pick
        self._sense(0.0)

    def advance(self, until: float) -> None:
        """Obey the servos until a time [s]."""
        for name, value in self._inbox.take().items():
            self._station.GetInputPort(name).FixValue(self._context, value)
        self._simulator.AdvanceTo(until)
        self._sense(until)

    def value(self, name: str) -> Any:
        return self._station.GetOutputPort(name).Eval(self._context)

    def pose(self) -> RigidTransform:
        """Return the true pose of the picked object, X_WO [m]."""
        X_WO: RigidTransform = self.value("object_poses_cheat")[self._pick]
        return X_WO

    def _sense(self, time: float) -> None:
        self.time = time
        self.bus.sense(time, {name: self.value(name) for name in self.bus.ports})


class SimulatedCamera(Camera):
    """A camera of a robot, without delay."""

    def __init__(self, robot: ServoRobot, name: str) -> None:
        self._robot, self._name = robot, name

    def picture(self, after: float, patience: float | None = None) -> Picture:
        return self.newest()

    def newest(self) -> Picture:
        color, depth = (
            np.array(self._robot.value(f"camera_{self._name}.{kind}_image").data)
            for kind in ("color", "depth")
        )
        return Picture(self._robot.time, color, depth[..., 0])


class DirectLine:
    """A line without a wire that loses packets; all replies while it is `silent`."""

    def __init__(self, bus: EmulatedBus, loss: float, seed: int) -> None:
        self.silent = False
        self._bus, self._loss = bus, loss
        self._random = np.random.default_rng(seed)
        self._reader, self._time = PacketReader(bus.packets), 0.0
        self._replies = b""

    def write(self, data: bytes) -> None:
        """Send an instruction; the servos reply at once."""
        self._time += 1.0  # so that an incomplete packet times out before the next
        packets = list(self._reader.feed(self._worn(data), self._time))
        for reply in self._bus.answer(packets):
            self._replies += self._worn(reply)

    def read(self, timeout: float) -> bytes:
        """Return the replies; nothing else ever arrives."""
        replies, self._replies = self._replies, b""
        return b"" if self.silent else replies

    def drain(self, silence: float = 0.0) -> None:
        self._replies = b""

    def close(self) -> None:
        pass

    def _worn(self, data: bytes) -> bytes:
        if not data or self._random.random() >= self._loss:
            return data
        lost = int(self._random.integers(len(data)))
        return data[:lost] + data[lost + 1 :]


def connect(
    scenario: Scenario, robot: ServoRobot, line: DirectLine, wire: Wire
) -> tuple[drivers.BusCycle, Hardware]:
    """Return the exchange with a robot's servos, and the links to them."""
    warnings = Warnings(lambda text: None)
    parts, n = MakeRobot(scenario, HardwareConfig(), warnings), len(scenario.arm.home)
    travel, _ = scenario.gripper.empty_hand(1.0)
    closed = round(JOINT.to_counts(-travel))
    bus: dict[str, Any] = {"port": "tcp:127.0.0.1:1", "protocol": wire.protocol}
    cycle = drivers.BusCycle(lambda: ServoBus(line, wire.protocol), warnings)
    links: list[Link] = []
    for driver in (
        drivers.DynamixelArm(**bus),
        drivers.DynamixelGripper(**bus, id=n + 1, open=JOINT.zero, closed=closed),
    ):
        driver.share(parts, cycle)  # so that nothing connects to the port
        link = driver.connect(parts)
        if wire.latency:
            faults = FaultsConfig(latency=wire.latency)
            link = FaultyLink(link, faults, scenario.arm.period)
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


def run_over_servos(seed: int, wire: Wire) -> ex.Measures:
    """Do the task, with everything but pictures over a servo bus.

    `error` is the larger of the placement errors in x and y; `rounding`, by how much
    whole counts of the joints may move the object where it is let go [mm].
    """
    scenario = load_scenario(_SCENARIO, seed=seed)
    robot = ServoRobot(scenario, wire.protocol, Warnings(lambda text: None))
    line, start = DirectLine(robot.bus, wire.loss, seed), robot.pose()
    cycle, hardware = connect(scenario, robot, line, wire)
    cell = MakeCell(scenario, lambda scenario: MakeHardwareStation(scenario, hardware))
    simulator = Simulator(cell)
    simulator.Initialize()
    context = simulator.get_context()
    status = cell.GetOutputPort("planner.status")
    safety = cell.GetOutputPort("safety.state")
    end, stopped, counts = scenario.planner.time_budget, "", math.nan
    while robot.time < end and not stopped:
        time = robot.time + scenario.arm.period
        if robot.time < wire.reboot <= time:
            robot.bus.servos[2].reboot()
        line.silent = wire.reboot <= time < wire.reboot + wire.silence
        cycle.cycle()
        simulator.AdvanceTo(time)
        robot.advance(time)
        state, why = safety_state(safety.Eval(context))
        if state in (SafetyState.PROTECTIVE_STOP, SafetyState.EMERGENCY_STOP):
            stopped = why.value
        mode = status.Eval(context).mode
        if mode is Mode.RELEASE and math.isnan(counts):
            q, _ = np.split(robot.value("arm.state_cheat"), 2)
            counts = rounding(scenario, q, robot.pose().translation())
        if mode in (Mode.DONE, Mode.FAILED):
            end = min(end, time + _SETTLE)
    for link in hardware.links:
        link.close()
    final, report = robot.pose(), status.Eval(context)
    error = final.translation() - final_pose(scenario, start).translation()
    tilt = final_tilt(scenario, start, final)
    near = np.linalg.norm(error) <= scenario.task.place.tolerance
    return {
        "claimed": report.mode is Mode.DONE,
        "placed": bool(near and (tilt is None or tilt <= _MAX_TILT)),
        "reason": stopped or (report.failure.value if report.failure else ""),
        "error": 1e3 * np.max(np.abs(error[:2])),
        "rounding": 1e3 * counts,
    }


def rounding(scenario: Scenario, q: Vector, p_WO: Vector) -> float:
    """Return the motion of a held object in x or y by half a count of each joint [m].

    The arm is at q (N,) [rad], the object at p_WO (3,) [m].
    """
    arm = ServoArm(MakeModelsPlant(scenario))
    p_GO_W = p_WO - arm.X_WG(q).translation()
    v, w = np.split(arm.jacobian(q), 2)
    of_object = v + np.cross(w, p_GO_W, axis=0)
    half = 0.5 * abs(JOINT.to_angle(1) - JOINT.to_angle(0))
    return float(half * np.max(np.sum(np.abs(of_object[:2]), axis=1)))


def cases(seeds: int = 20) -> list[ex.Case]:
    """Do the task without a bus, and over every kind of wire."""
    return ex.grid(wire=(_WITHOUT, *WIRES), seed=range(seeds))


def trial(wire: str, seed: int) -> ex.Measures:
    if wire != _WITHOUT:
        return run_over_servos(seed, WIRES[wire])
    cycle = run_cycle(_SCENARIO, seed)
    error = cycle["placement"]
    return {
        "claimed": cycle["failure"] is None,
        "placed": cycle["placed"],
        "reason": cycle["failure"] or "",
        "error": None if error is None else 1e3 * max(abs(error[0]), abs(error[1])),
        "rounding": 0.0,
    }


def summary(own: ex.Trials) -> ex.Values:
    n, clean = len(own), own.name in _CLEAN
    placed, missed = own.where(placed=True), own.where(placed=False)
    worst = max(placed["error"], default=np.nan)
    what, count = "largest placement error in x or y [mm]", f"placed, of {n} []"
    if own.name == _WITHOUT:
        return {count: len(placed), what: worst}
    counts = max(placed["rounding"], default=np.nan)
    limit = 2.0 * max(own.whole.where(wire=_WITHOUT)["error"]) + counts
    found: ex.Values = {
        "claimed, but not placed []": sum(missed["claimed"]),
        "neither placed nor told why []": sum(not t["reason"] for t in missed),
        count: (len(placed), ex.at_least(n) if clean else None),
    }
    if len(placed) or clean:
        found[what] = (worst, ex.at_most(limit))
    if len(placed):
        found["of the limit, half a count of each joint [mm]"] = counts
    return found


servo_bus = ex.Experiment(
    "The five-axis arm's task by our planner over a bus of emulated servos.",
    cases,
    trial,
    dict.fromkeys(
        ("claimed, but not placed", "neither placed nor told why"), ex.at_most(0)
    ),
    summary=summary,
    picture=[ex.Histogram("error")],
)
