"""Drivers of arms and grippers with Dynamixel servos."""

import dataclasses as dc
import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.config import Config, positive
from drake_srg.gripper.driver import GripperDriver
from drake_srg.robot.drive.dynamixel.bus import BusError, ServoBus, open_line
from drake_srg.robot.drive.link import HardwareDriver, Link, Mailbox, Robot
from drake_srg.robot.serve.commands import PortValues, Warnings
from drake_srg.robot.serve.dynamixel.registers import TURN, ServoState
from drake_srg.types import Vector

# Takes the states of the servos, in the order of their IDs.
Report = Callable[[Sequence[ServoState]], None]


class ServoGroup:
    """The servos of an arm or a gripper, handled by the thread of a bus.

    The group sets up each servo: it switches the torque on, makes the present position
    the goal, and lights the LED. A dark LED later means that the servo has rebooted and
    lost these settings. The group then sets it up again, unless it is too far from its
    goal.

    The whole group halts for good if a rebooted servo is too far from its goal, or if a
    servo has switched its own torque off, such as after an overload. It then commands
    and reports nothing. The safety monitor notices the silence and stops the robot.

    Args:
        report: Called with the servos' states, in the bus's thread.
        effort: Largest torque, as a fraction of the stall torque.
        resume_within: Largest distance from its goal at which a rebooted servo
            continues [counts].

    Attributes:
        ids: IDs of the servos.
        goals: Positions to command, by ID [counts]. Another thread may replace the
            mapping at any time.
        halted: Why the group has halted; empty while it works.
    """

    def __init__(
        self,
        ids: Sequence[int],
        report: Report,
        warnings: Warnings,
        effort: float = 1.0,
        resume_within: float = math.inf,
    ) -> None:
        self.ids = ids
        self.goals: Mapping[int, int] = {}
        self.halted = ""
        self._effort, self._resume_within = effort, resume_within
        self._report, self._warnings = report, warnings
        self._ready: set[int] = set()

    def exchange(self, bus: ServoBus, states: Mapping[int, ServoState]) -> bool:
        """Handle the servos' states: report them, and set up servos if necessary.

        Returns:
            Whether their goals may be commanded.

        Raises:
            BusError: If a servo cannot be set up.
        """
        goals = self.goals
        for number in self.ids:
            if self.halted:
                return False
            state = states[number]
            if number not in self._ready:
                self._set_up(bus, number, state)
            elif not state.marked:
                self._resume(bus, number, state, goals.get(number, state.position))
            elif not state.torque:
                why = state.fault or "its torque is off"
                self._halt(f"servo {number} has shut down ({why})")
            elif state.fault:
                self._warnings.warn(
                    f"servo {number} {state.fault}", f"servo {number}: {state.fault}"
                )
        if self.halted:
            return False
        self._report([states[number] for number in self.ids])
        return True

    def _resume(self, bus: ServoBus, number: int, state: ServoState, goal: int) -> None:
        away = abs(state.position - goal)
        if away > self._resume_within:
            self._halt(
                f"servo {number} has rebooted and is {away} counts from its goal "
                f"(allowed: {self._resume_within:.0f})"
            )
            return
        self._set_up(bus, number, state)
        self._warnings.warn(
            f"servo {number} reboot",
            f"servo {number} has rebooted, {away} counts from its goal; it goes on",
        )

    def _set_up(self, bus: ServoBus, number: int, state: ServoState) -> None:
        """Switch the torque on at the present position; light the LED last."""
        effort = round(self._effort * bus.table.full_effort)
        bus.write(number, bus.table.effort, effort)
        bus.write(number, "torque_enable", 1)
        bus.write(number, "goal_position", state.position)
        bus.write(number, "led", 1)
        self._ready.add(number)

    def _halt(self, why: str) -> None:
        self.halted = why
        self._warnings.warn(f"halt {why}", f"{why}; nothing commands it any more")


class BusCycle:
    """Reads the servos of all groups and commands their goals, once per `cycle`.

    If one servo does not reply, no group reports anything, and the next call opens the
    line again.

    Args:
        open_bus: Opens the bus; raises an OSError if it cannot.

    Raises:
        OSError: If the bus cannot be opened.
    """

    def __init__(self, open_bus: Callable[[], ServoBus], warnings: Warnings) -> None:
        self._open, self._warnings = open_bus, warnings
        self._groups: tuple[ServoGroup, ...] = ()
        self._bus: ServoBus | None = open_bus()
        self.closed = False

    def add(self, group: ServoGroup) -> None:
        """Add a group of servos."""
        self._groups = (*self._groups, group)

    def remove(self, group: ServoGroup) -> None:
        """Remove a group, whose servos stay where they are; after the last, close."""
        self._groups = tuple(other for other in self._groups if other is not group)
        if not self._groups and not self.closed:
            self.closed = True
            self.end()

    def end(self) -> None:
        """Close the bus."""
        if self._bus is not None:
            self._bus.close()
            self._bus = None

    def cycle(self) -> bool:
        """Exchange states and goals with all servos; return whether that succeeded."""
        groups = [group for group in self._groups if not group.halted]
        numbers = [number for group in groups for number in group.ids]
        try:
            if self._bus is None:
                self._bus = self._open()
            if numbers:
                states = self._bus.read_states(numbers)
                obeying = [g for g in groups if g.exchange(self._bus, states)]
                goals = {k: goal for g in obeying for k, goal in g.goals.items()}
                if goals:
                    self._bus.sync_write("goal_position", goals)
        except (BusError, OSError) as error:
            self._warnings.warn("servo bus", f"servo bus: {error}; it is tried again")
            if self._bus is not None:
                self._bus.close()
                self._bus = None
            return False
        self._warnings.forget("servo bus")
        return True


_PAUSE = 0.1  # before a lost bus is opened again [s]


class BusThread(BusCycle):
    """A thread that repeats `cycle` from the first `add` until the last `remove`.

    Args:
        open_bus: See `BusCycle`.
        period: Time between exchanges [s].
        warnings: See `BusCycle`.

    Raises:
        OSError: If the bus cannot be opened.
    """

    def __init__(
        self, open_bus: Callable[[], ServoBus], period: float, warnings: Warnings
    ) -> None:
        super().__init__(open_bus, warnings)
        self._period = period
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, name="servo bus", daemon=True)

    def add(self, group: ServoGroup) -> None:
        """Add a group of servos; the first one starts the thread."""
        super().add(group)
        if self._thread.ident is None:
            self._thread.start()

    def end(self) -> None:
        """Close the bus, after the exchange that is under way."""
        self._done.set()
        if self._thread.ident is not None:
            self._thread.join()
        super().end()

    def _run(self) -> None:
        due = time.monotonic()
        while not self._done.is_set():
            pause = 0.0 if self.cycle() else _PAUSE
            due = max(due + self._period, time.monotonic() + pause)
            self._done.wait(due - time.monotonic())


_COUNT = math.tau / TURN  # rad
_ENTRIES = 201  # of the table of a gripper's positions


@dc.dataclass(kw_only=True)
class DynamixelConfig(Config, HardwareDriver):
    """A part of a robot with servos on a bus. Parts at the same port share the bus."""

    # `tcp:HOST:PORT`, a serial device or a pseudo terminal.
    port: str = "/dev/ttyUSB0"
    baud: int = 1_000_000
    # Dynamixel protocol, 1 or 2.
    protocol: int = dc.field(default=1, metadata={"ge": 1, "le": 2})
    # Time between exchanges with all servos, and the longest silence in one [s].
    period: float = dc.field(default=0.01, metadata=positive())
    timeout: float = dc.field(default=0.01, metadata=positive())
    # How often an instruction without an intact reply is repeated.
    retries: int = dc.field(default=1, metadata={"ge": 0})

    def bus_of(self, robot: Robot) -> BusCycle:
        """Return the bus, which all parts at the port share.

        Raises:
            ScenarioError: If the port is invalid, or another part has other settings.
            OSError: If the bus cannot be opened.
        """
        known, bus = robot.shared.get(self.port, (self._settings, None))
        if known != self._settings:
            raise ScenarioError(
                f"hardware: {self.port}: arm and gripper need the same baud, protocol, "
                "period, timeout and retries"
            )
        if bus is None or bus.closed:
            try:
                bus = BusThread(self._open, self.period, robot.warnings)
            except ValueError as error:
                raise ScenarioError(f"hardware: {error}") from None
            self.share(robot, bus)
        return bus

    def share(self, robot: Robot, bus: BusCycle) -> None:
        """Make `bus_of` return a given bus."""
        robot.shared[self.port] = self._settings, bus

    @property
    def _settings(self) -> tuple[float, ...]:
        return (self.baud, self.protocol, self.period, self.timeout, self.retries)

    def _open(self) -> ServoBus:
        line = open_line(self.port, self.baud)
        return ServoBus(line, self.protocol, self.timeout, self.retries)


@dc.dataclass(kw_only=True)
class DynamixelArm(DynamixelConfig):
    """An arm with a servo per joint, in position control."""

    # IDs of the servos, in the order of the joints; empty: 1, 2, 3 and so on.
    ids: list[int] = dc.field(default_factory=list)
    # Position at the joint's zero [counts], and the sign of the rotation: 1 if the
    # position rises with the joint's angle, otherwise -1. One entry for all joints, or
    # one per joint. A command beyond the servo's turn is refused, with a warning.
    zero: list[int] = dc.field(default_factory=lambda: [TURN // 2])
    direction: list[int] = dc.field(default_factory=lambda: [1])
    # Torque of a joint at full load, one entry per joint [N m]; empty: unknown.
    full_torque: list[float] = dc.field(default_factory=list)
    # Delay of the joints in a steady motion [s]: position servos trail by damping over
    # stiffness and by their ramps, plus the time of an exchange. The emulated servos of
    # the five-axis arm follow 0.11 s late. The safety monitor's `following_error` is
    # larger by the fastest joint's motion in this time.
    lag: float = dc.field(default=0.12, metadata={"ge": 0.0})
    # Largest distance from its goal at which a rebooted joint continues [rad].
    resume_within: float = dc.field(default=0.05, metadata=positive())

    def connect(self, robot: Robot) -> Link:
        """Return a link to the hardware."""
        n = len(robot.arm_joints)
        for name, allowed in (
            ("ids", (0, n)),
            ("zero", (1, n)),
            ("direction", (1, n)),
            ("full_torque", (0, n)),
        ):
            if len(getattr(self, name)) not in allowed:
                raise ScenarioError(
                    f"hardware: arm.{name}: needs {' or '.join(map(str, allowed))} "
                    f"entries, got {len(getattr(self, name))}"
                )
        if not set(self.direction) <= {-1, 1}:
            raise ScenarioError("hardware: arm.direction: entries must be 1 or -1")
        return _ArmLink(self, robot, self.bus_of(robot))


class _ArmLink(Link):
    def __init__(self, config: DynamixelArm, robot: Robot, bus: BusCycle) -> None:
        n = len(robot.arm_joints)
        self.outputs = {"arm.state_measured": 2 * n}
        self.lag = config.lag
        self._torque = np.array(config.full_torque)
        if config.full_torque:
            self.outputs["arm.torque_measured"] = n
        self._ids = config.ids or list(range(1, n + 1))
        self._zero, self._direction = np.array(config.zero), np.array(config.direction)
        self._names, self._warnings = robot.arm_joints, robot.warnings
        # Positions of the joints at the ends of the servos' turn, shape (2, N) [rad].
        ends = [self._angles(np.full(n, count)) for count in (0, TURN - 1)]
        self._ends = np.sort(ends, axis=0)
        self._mail, self._bus = Mailbox(), bus
        self._group = ServoGroup(
            self._ids,
            self._receive,
            robot.warnings,
            resume_within=config.resume_within / _COUNT,
        )
        bus.add(self._group)

    def take(self) -> PortValues:
        return self._mail.take()

    def send(self, commands: PortValues) -> None:
        q = commands["arm.position_commanded"]
        if not np.isfinite(q).all():
            return
        counts = np.rint(self._zero + self._direction * q / _COUNT)
        # Rounding takes half a turn from the middle one count too far.
        outside = np.flatnonzero((counts < 0) | (counts > TURN)).tolist()
        for i in outside:
            self._refuse(i, q[i])
        if not outside:
            goals = np.minimum(counts, TURN - 1).astype(int).tolist()
            self._group.goals = dict(zip(self._ids, goals, strict=True))

    def _refuse(self, i: int, q: float) -> None:
        """Warn that joint i cannot reach a position [rad]."""
        low, high = self._ends[:, i]
        self._warnings.warn(
            f"servo {self._ids[i]} turn",
            f"arm: {self._names[i]}: must be {low:.3f} to {high:.3f} rad, the turn of "
            f"servo {self._ids[i]}, got {q:.3g} (check arm.zero and arm.direction); "
            "the last good command holds",
        )

    def close(self) -> None:
        self._bus.remove(self._group)

    def _angles(self, counts: Vector) -> Vector:
        q: Vector = self._direction * (counts - self._zero) * _COUNT
        return q

    def _receive(self, states: Sequence[ServoState]) -> None:
        counts = np.array([state.position for state in states])
        q = self._angles(counts)
        v = self._direction * [state.velocity for state in states]
        values = {"arm.state_measured": np.concatenate([q, v])}
        if self._torque.size:
            load = self._direction * [state.load for state in states]
            values["arm.torque_measured"] = self._torque * load
        self._mail.put(values)


@dc.dataclass(kw_only=True)
class DynamixelGripper(DynamixelConfig):
    """A gripper with one servo and no finger sensors, such as the SRG.

    The joints are assumed to be those of an empty hand at the servo's position. While
    the servo's load is at least `contact_load`, all fingers report contact.
    """

    # ID of the servo.
    id: int = dc.field(default=1, metadata={"ge": 0, "le": 252})
    # Positions with the fingers open and with closure 1 [counts]; they must differ.
    open: int = 0
    closed: int = 0
    # Largest torque, as a fraction of the stall torque: the force of the grip.
    effort: float = dc.field(default=0.5, metadata=positive(le=1.0))
    # How far the servo moves under full load while the fingers stand still, because the
    # wires stretch [counts].
    stretch: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # Load that means contact, as a fraction of the stall torque. It must exceed the
    # load of friction and springs, and be below `effort`.
    contact_load: float = dc.field(default=0.15, metadata=positive(le=1.0))

    def connect(self, robot: Robot) -> Link:
        """Return a link to the hardware."""
        gripper = robot.scenario.gripper
        if gripper is None:
            raise ScenarioError("hardware: gripper: the scenario has none")
        if self.open == self.closed:
            raise ScenarioError("hardware: gripper.closed: must differ from open")
        if self.contact_load >= self.effort:
            raise ScenarioError(
                "hardware: gripper.contact_load: must be below effort "
                f"({self.effort:g}), got {self.contact_load:g}"
            )
        return _GripperLink(self, gripper, robot, self.bus_of(robot))


class _GripperLink(Link):
    def __init__(
        self,
        config: DynamixelGripper,
        gripper: GripperDriver,
        robot: Robot,
        bus: BusCycle,
    ) -> None:
        n, self._m = len(gripper.joint_names), len(gripper.sensor_names)
        self.outputs = {
            "gripper.state_measured": 2 * n,
            "gripper.triggered": self._m,
            "gripper.proximity": self._m,
        }
        self._far = gripper.proximity.range
        self._config = config
        # A table of closure, share of the servo's travel, and joints of an empty hand.
        self._closure = np.linspace(0.0, 1.0, _ENTRIES)
        ways, joints = zip(*map(gripper.empty_hand, self._closure), strict=True)
        self._way, self._joints = np.array(ways) / ways[-1], np.array(joints)
        self._mail, self._bus = Mailbox(), bus
        self._position: int | None = None  # of the servo [counts]
        self._pressing = self._held = False
        self._group = ServoGroup(
            [config.id], self._receive, robot.warnings, effort=config.effort
        )
        bus.add(self._group)

    def take(self) -> PortValues:
        return self._mail.take()

    def send(self, commands: PortValues) -> None:
        (closure,) = commands["gripper.closure_commanded"]
        if commands["gripper.hold"][0] > 0.5:
            # Fingers that press on something keep their goal, and thereby their grip.
            if not self._held and not self._pressing and self._position is not None:
                self._group.goals = {self._config.id: self._position}
            self._held = True
            return
        self._held = False
        if math.isfinite(closure):
            way = np.interp(closure, self._closure, self._way)
            travel = self._config.closed - self._config.open
            goal = round(float(self._config.open + travel * way))
            self._group.goals = {self._config.id: goal}

    def close(self) -> None:
        self._bus.remove(self._group)

    def _receive(self, states: Sequence[ServoState]) -> None:
        (state,) = states
        travel = self._config.closed - self._config.open
        relaxed = state.position - self._config.stretch * state.load
        way = (relaxed - self._config.open) / travel
        speed = state.velocity / _COUNT / travel
        q = self._joints_at(way)
        v = (self._joints_at(way + _NEARBY) - q) / _NEARBY * speed
        pressing = state.load * math.copysign(1.0, travel) >= self._config.contact_load
        self._position, self._pressing = state.position, pressing
        self._mail.put(
            {
                "gripper.state_measured": np.concatenate([q, v]),
                "gripper.triggered": np.full(self._m, float(pressing)),
                "gripper.proximity": np.full(self._m, 0.0 if pressing else self._far),
            }
        )

    def _joints_at(self, way: float) -> Vector:
        return np.array([np.interp(way, self._way, q) for q in self._joints.T])


_NEARBY = 1e-3  # step of a difference quotient over the servo's way
