"""The loop that advances a twin to the times of its robot's messages."""

from __future__ import annotations

import dataclasses as dc
import math
import threading
import time as wall
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context, Diagram

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.systems import MakeSimulator, joint_unit, model_actuators
from drake_srg.lifetime import my_context
from drake_srg.objects.models import object_body
from drake_srg.robot.drive.config import ArmHardware, HardwareConfig
from drake_srg.robot.drive.link import JOINT_STATE, JointStates, Robot, RosDriver
from drake_srg.robot.serve.commands import CommandError
from drake_srg.robot.twin.comparison import KINDS, Sighting, read_blobs
from drake_srg.robot.twin.station import twin_period
from drake_srg.scenario import Scenario, robot_arms
from drake_srg.scenario.schema import TwinConfig
from drake_srg.simulation import failure_time
from drake_srg.station.sleeping import MakeAdvance
from drake_srg.types import Vector


@dc.dataclass(frozen=True)
class ToldArm:
    """The latest messages of an arm and its gripper.

    Attributes:
        state: [q; v] of the arm's joints, shape (2N,) [rad, rad/s].
        torque: Torques of these joints, shape (N,) [N m]; NaN: not published.
        fingers: [q; v] of the fingers, shape (2n,) [rad, rad/s]; NaN: not published.
        closure: Command to the gripper, 0 open .. 1 closed; None: no command yet.
    """

    state: Vector
    torque: Vector
    fingers: Vector
    closure: float | None = None


@dc.dataclass(frozen=True)
class Told:
    """A robot's latest messages. Times are by the robot's clock.

    Attributes:
        stamp: Time of the arms' states [s].
        arms: The messages of each arm.
        sightings: Sightings of objects since the last call of `Listener.take`.
    """

    stamp: float
    arms: tuple[ToldArm, ...]
    sightings: tuple[Sighting, ...] = ()


class _Heard:
    """Receives the messages of an arm and its gripper, and keeps the latest.

    Args:
        drivers: The drivers of both; they must speak ROS.
        twin: The twin's topics.
        robot: The robot, with nodes that are not yet open.
        lock: Held while a message is processed.
    """

    def __init__(
        self, drivers: ArmHardware, twin: TwinConfig, robot: Robot, lock: threading.Lock
    ) -> None:
        for key, driver in (("arm", drivers.arm), ("gripper", drivers.gripper)):
            if not isinstance(driver, RosDriver):
                raise ScenarioError(
                    f"{robot.own.key}{key}: a twin cannot listen to "
                    f"!{type(driver).__name__}, because a bus has one master (allowed: "
                    "the drivers of ROS 1 and ROS 2)"
                )
        arm, gripper = drivers.arm, drivers.gripper
        assert isinstance(arm, RosDriver)
        assert isinstance(gripper, RosDriver)
        self._lock = lock
        self._arm = JointStates(arm.names(robot))
        self._fingers = JointStates(gripper.names(robot))
        # The arm's stamp, state and torques; None: not new since the last `take`.
        self.new: tuple[float, Vector, Vector] | None = None
        self.gripper_state = np.full(2 * len(robot.gripper_joints), np.nan)
        self.closure: float | None = None
        self.node = robot.nodes.of(gripper.version)
        arms = robot.nodes.of(arm.version)
        arms.subscribe(robot.topic(arm.state), JOINT_STATE, self._receive_arm)
        fingers = robot.topic(gripper.state)
        self.node.subscribe(fingers, JOINT_STATE, self._receive_gripper)
        for topic, kind, receive in (
            (twin.closure, "std_msgs/msg/Float64", self._receive_closure),
            (twin.grasp, "std_msgs/msg/Int32", self._receive_grasp),
        ):
            if topic:
                self.node.subscribe(robot.topic(topic), kind, receive)

    def _receive_arm(self, message: Any) -> None:
        with self._lock:
            read = self._arm.read(message)
            if read is None:
                return
            stamp, state, effort = read
            torque = np.full(len(state) // 2, np.nan) if effort is None else effort
            self.new = stamp, state, torque

    def _receive_gripper(self, message: Any) -> None:
        with self._lock:
            read = self._fingers.read(message)
            if read is not None:
                self.gripper_state = read[1]

    def _receive_closure(self, message: Any) -> None:
        self._command(float(message.data), closed=1)

    def _receive_grasp(self, message: Any) -> None:
        self._command(float(message.data), closed=100)

    def _command(self, value: float, closed: int) -> None:
        if not 0.0 <= value <= closed:
            raise CommandError(
                "range", f"must be 0 (open) to {closed} (closed), got {value:g}"
            )
        with self._lock:
            self.closure = value / closed


class Listener:
    """Subscribes to a robot's topics. Any thread may deliver messages.

    Args:
        config: The drivers, which must speak ROS.
        twin: The twin's topics.
        robots: A `Robot` for each arm; the caller opens their nodes.

    Attributes:
        heard_at: When `take` last returned messages [s, real].

    Raises:
        ScenarioError: If a driver has no topics.
    """

    def __init__(
        self, config: HardwareConfig, twin: TwinConfig, *robots: Robot
    ) -> None:
        self._lock = threading.Lock()
        self._heard = [
            _Heard(config.drivers[robot.own.name], twin, robot, self._lock)
            for robot in robots
        ]
        self._sightings: list[Sighting] = []
        self.heard_at = -math.inf
        if twin.blobs:
            node = self._heard[0].node
            node.subscribe(twin.blobs, "std_msgs/msg/String", self._receive_blobs)

    def take(self) -> Told | None:
        """Return the messages if all arms' states are new since the last call."""
        with self._lock:
            new = [arm.new for arm in self._heard if arm.new is not None]
            if len(new) < len(self._heard):
                return None
            for arm in self._heard:
                arm.new = None
            self.heard_at = wall.monotonic()
            seen, self._sightings = tuple(self._sightings), []
            arms = tuple(
                ToldArm(state, torque, arm.gripper_state, arm.closure)
                for (_, state, torque), arm in zip(new, self._heard, strict=True)
            )
            return Told(max(stamp for stamp, _, _ in new), arms, seen)

    def _receive_blobs(self, message: Any) -> None:
        seen = read_blobs(message.data)
        with self._lock:
            self._sightings += seen


# Only contact moves an object that is nearer to the hand's grasp center than this [m]:
# half a finger and half a can.
_HAND = 0.15
# An object rests if it moves less than this from one picture to the next [m].
_RESTS = 0.01


class Placing:
    """Moves objects of a plant to where they are seen.

    It does so at an object's first sighting, and again once object and twin have
    parted. It never moves an object near the hand: there, simulated contact decides
    whether the hand holds it. Call it between two steps of the simulation.

    Args:
        plant: The plant.
        context: The plant's context, which `place` changes.
        names: Names of the objects.
        grippers: Names of the grippers' models.

    Attributes:
        placed_at: When each object was last moved [s], by name.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        context: Context,
        names: Sequence[str],
        grippers: Sequence[str] = ("gripper",),
    ) -> None:
        self._plant, self._context = plant, context
        bodies = {
            name: object_body(plant, plant.GetModelInstanceByName(name))
            for name in names
        }
        self._bodies = {n: b for n, b in bodies.items() if isinstance(b, BodyIndex)}
        models = map(plant.GetModelInstanceByName, grippers)
        self._hands = [plant.GetFrameByName("grasp_center", model) for model in models]
        self._last: dict[str, Vector] = {}
        self.placed_at: dict[str, float] = {}

    def place(
        self, sightings: Sequence[Sighting], parted: Mapping[str, bool], time: float
    ) -> list[str]:
        """Move objects to where they are seen; return the names of those moved.

        Args:
            sightings: The new sightings.
            parted: Whether each object is known to be elsewhere than in the twin.
            time: Now [s].
        """
        hands = [hand.CalcPoseInWorld(self._context) for hand in self._hands]
        p_WH = np.array([X_WH.translation() for X_WH in hands])
        moved = []
        for seen in sightings:
            body = self._bodies.get(seen.name)
            if body is None or not seen.clear:
                continue
            p_WO = seen.X_WO.translation()
            last = self._last.get(seen.name, np.full(3, np.inf))
            self._last[seen.name] = p_WO
            first = seen.name not in self.placed_at
            rests = bool(np.linalg.norm(p_WO - last) < _RESTS)
            far = bool(np.min(np.linalg.norm(p_WO - p_WH, axis=1)) > _HAND)
            if far and rests and (first or parted.get(seen.name, False)):
                self._put(body, seen)
                self.placed_at[seen.name] = time
                moved.append(seen.name)
        return moved

    def _put(self, index: BodyIndex, seen: Sighting) -> None:
        body = self._plant.get_body(index)
        self._plant.SetFreeBodyPose(self._context, body, seen.X_WO)
        self._plant.SetVelocities(self._context, body.model_instance(), np.zeros(6))


# Units of a joint's torque, by that of its position.
TORQUE_UNITS = {"rad": "N m", "m": "N"}
_ROUNDING = 1e-6  # of stamps, which are whole nanoseconds [s]


@dc.dataclass(frozen=True)
class Parting:
    """A report of a lasting difference between a robot and its twin.

    Attributes:
        time: Time of the report [s].
        kind: One of `KINDS`.
        difference: The largest difference, in the unit of the limit.
        limit: The limit that it exceeds.
        text: A sentence for the user.
    """

    time: float
    kind: str
    difference: float
    limit: float
    text: str


class TwinLoop:
    """Advances a twin to the times of its robot's messages.

    The twin's clock is the robot's clock, starting at 0, so nothing depends on this
    machine's speed. Between two messages, states are interpolated linearly. Only
    `follow` touches the context, so one thread does all of the work.

    Args:
        name: The scenario's name, for messages.
        scenario: The twin's scenario.
        root: The root diagram, which contains the twin.
        twin: A twin from `MakeTwin`.
        first: The robot's first messages, where the arms start.

    Attributes:
        joint_units: Units of the arms' joint positions, rad or m.
        partings: All reports so far.
        largest: Largest difference of each of `KINDS` so far, shape (4,).
        skipped: Time that was skipped, where messages were too far apart [s].
    """

    def __init__(
        self,
        name: str,
        scenario: Scenario,
        root: Diagram,
        twin: Diagram,
        first: Told,
    ) -> None:
        self._name, self._twin, self._config = name, twin, scenario.twin
        self._period, self._start = twin_period(scenario), first.stamp
        self._simulator = MakeSimulator(root, scenario.simulator_config)
        self._simulator.set_target_realtime_rate(0.0)
        self.context = self._simulator.get_mutable_context()
        self._own = my_context(twin, self.context)
        plant = twin.GetSubsystemByName("station").GetSubsystemByName("plant")
        plant_context = plant.GetMyMutableContextFromRoot(self.context)
        self._robots = robot_arms(scenario)
        self._efforts, self._joints = list[float](), list[str]()
        self.joint_units = list[str]()
        self._finger_joints = list[str]()
        for robot, told in zip(self._robots, first.arms, strict=True):
            arm = plant.GetModelInstanceByName(robot.arm_model)
            actuators = model_actuators(plant, arm)
            efforts = [a.effort_limit() for a in actuators]
            plant.SetPositions(plant_context, arm, told.state[: len(efforts)])
            whose = f" of {robot.name}" if robot.name else ""
            fingers = robot.gripper.joint_names if robot.gripper else ()
            self._efforts += efforts
            self.joint_units += [joint_unit(a.joint()) for a in actuators]
            self._joints += [f"joint {i + 1}{whose}" for i in range(len(efforts))]
            self._finger_joints += [
                f"finger joint {i + 1}{whose}" for i in range(len(fingers))
            ]
        self._names = [n for n, config in scenario.objects.items() if config.present]
        hands = [robot.gripper_model for robot in self._robots]
        self._placing = Placing(plant, plant_context, self._names, hands)
        self._seen: dict[str, Sighting] = {}
        self._told, self._steps = first, 0
        self._quiet_until = self._config.settle
        self._parted = np.zeros(len(KINDS), dtype=bool)
        self.partings: list[Parting] = []
        self.largest, self.skipped = np.zeros(len(KINDS)), 0.0
        self._fix(first, first, 0.0)
        with failure_time(name, self._simulator):
            self._simulator.Initialize()
        self._advance = MakeAdvance(self._simulator, twin, scenario)

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return float(self.context.get_time())

    def value(self, port: str) -> Any:
        """Return the present value of an output port of the twin."""
        return self._twin.GetOutputPort(port).Eval(self._own)

    @property
    def force(self) -> float:
        """Largest force at any finger of the twin [N]."""
        ports = [f"{robot.gripper_model}.contact_force" for robot in self._robots]
        return max(float(self.value(port).max(initial=0.0)) for port in ports)

    def follow(self, told: Told) -> list[Parting]:
        """Advance to the time of the robot's messages; return the new reports.

        Raises:
            ScenarioError: If Drake fails.
        """
        last, begin = self._told, self._time_of(self._told.stamp)
        end = self._time_of(told.stamp)
        gap = end - begin
        if gap > self._config.silence:  # the robot's clock was set, or it was silent
            self.skipped += gap - self._period
            end = begin + self._period
        if gap > self._config.patience:
            self._quiet_until = end + self._config.settle
        self._told = told
        shift = self._start + self.skipped
        for seen in told.sightings:
            self._seen[seen.name] = dc.replace(seen, time=seen.time - shift)
        new: list[Parting] = []
        self._place(told)
        while (self._steps + 1) * self._period <= end + _ROUNDING:
            share = (self.time - begin) / max(end - begin, self._period)
            self._fix(last, told, min(max(share, 0.0), 1.0))
            self._steps += 1
            with failure_time(self._name, self._simulator):
                self._advance(self._steps * self._period)
            new += self._reports()
        return new

    def _time_of(self, stamp: float) -> float:
        return stamp - self._start - self.skipped

    def _place(self, told: Told) -> None:
        """Move objects that have parted to where they are seen."""
        where = dict(zip(self._names, self.value("twin.object_error"), strict=True))
        parted = {
            name: bool(self._parted[KINDS.index("object")])
            and error > self._config.object
            for name, error in where.items()
        }
        self._placing.place(told.sightings, parted, self.time)

    def _fix(self, last: Told, told: Told, share: float) -> None:
        """Set the twin's inputs, interpolated between two messages (share 0 .. 1)."""
        values: dict[str, Any] = {
            "robot.sightings": AbstractValue.Make(tuple(self._seen.values())),
            "robot.placed_at": AbstractValue.Make(dict(self._placing.placed_at)),
        }
        arms = zip(self._robots, last.arms, told.arms, strict=True)
        for robot, before, now in arms:
            arm, gripper = robot.arm_model, robot.gripper_model
            values |= {
                f"robot.{arm}_state": (1.0 - share) * before.state + share * now.state,
                f"robot.{arm}_torque": now.torque,
                f"robot.{arm}_torque_or_zero": np.nan_to_num(now.torque),
                f"robot.{gripper}_state": now.fingers,
                f"{gripper}.closure_commanded": [now.closure or 0.0],
            }
        for name, value in values.items():
            self._twin.GetInputPort(name).FixValue(self._own, value)

    def _reports(self) -> list[Parting]:
        """Return a report for each kind of difference that has just parted."""
        difference = self.value("twin.difference")
        self.largest = np.maximum(self.largest, difference)
        parted = self.value("twin.parted") > 0.5
        if self.time < self._quiet_until:
            return []
        begun, self._parted = parted & ~self._parted, parted
        new = []
        for kind, amount in zip(
            np.array(KINDS)[begun], difference[begun].tolist(), strict=True
        ):
            limit = float(getattr(self._config, kind))
            text = f"t = {self.time:.2f} s: {self._sentence(kind, amount, limit)}"
            new.append(Parting(self.time, str(kind), amount, limit, text))
        self.partings += new
        return new

    def _sentence(self, kind: str, amount: float, limit: float) -> str:
        def worst(port: str) -> int:
            return int(np.argmax(np.abs(np.nan_to_num(self.value(port)))))

        if kind == "joint":
            i = worst("twin.joint_error")
            return (
                f"{self._joints[i]} is {amount:.3f} {self.joint_units[i]} from the "
                f"twin's (limit {limit:g})"
            )
        if kind == "torque":
            residual = np.nan_to_num(self.value("twin.torque_residual"))
            i = int(np.argmax(np.abs(residual) / self._efforts))
            unit = TORQUE_UNITS[self.joint_units[i]]
            return (
                f"{self._joints[i]} has {amount * self._efforts[i]:.1f} {unit} more or "
                f"less than the twin expects, {amount:.1%} of its largest torque "
                f"(limit {limit:.1%})"
            )
        if kind == "finger":
            i = worst("twin.finger_error")
            more = "more" if self.value("twin.finger_error")[i] > 0.0 else "less"
            return (
                f"{self._finger_joints[i]} is {amount:.3f} rad {more} closed than the "
                f"twin's (limit {limit:g})"
            )
        name = self._names[worst("twin.object_error")]
        return f"{name} is seen {amount:.3f} m from the twin's (limit {limit:g})"
