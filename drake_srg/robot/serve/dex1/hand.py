"""A hand with SAKE's driver, which commands an emulated MX-64 at 30 Hz."""

from __future__ import annotations

import dataclasses as dc
import enum
import math
from collections.abc import Mapping

from drake_srg.robot.serve.commands import CommandInbox
from drake_srg.robot.serve.dynamixel.bridge import EmulatedBus, WiredGripper
from drake_srg.robot.serve.dynamixel.mx64 import Mx64P2
from drake_srg.robot.serve.dynamixel.protocol import Fault, Instruction, Packet2
from drake_srg.robot.serve.dynamixel.registers import Mode
from drake_srg.types import Vector

# The grasp manager: thresholds, states and forces of the driver's default configuration
# (SAKErobotics/unitree-dex1-ezgripper-driver). Positions are in percent: 100 open,
# 0 closed, 2500 counts of the servo apart. Forces are in percent of the current limit.
_STALL = 2.0  # spread of positions below which the fingers stand still [%]
_STALL_AT_ZERO = 0.04  # the same where the fingers meet [%]: one count
_BLOCKED = 5.0  # distance from the goal from which something blocks the fingers [%]
_AT_ZERO = 1.0  # goals and positions up to here count as closed [%]
_SAMPLES = 3  # number of positions to compare, and of cycles in which they must agree
_CHANGE = 1.0  # smallest change of a position that counts [%]


class GraspState(enum.IntEnum):
    """State of a grasp, numbered as in the driver's messages."""

    IDLE = 0
    MOVING = 1
    CONTACT = 2
    GRASPING = 3


FORCES = {
    GraspState.IDLE: 10.0,
    GraspState.MOVING: 50.0,
    GraspState.CONTACT: 20.0,
    GraspState.GRASPING: 15.0,
}


@dc.dataclass(frozen=True)
class Grasp:
    """The grasp manager's state, which it keeps from cycle to cycle.

    Attributes:
        goal: The position to go to [%].
        commanded: The last commanded position [%]; None before the first.
        recent: The last positions of closing fingers, newest last [%].
        stalls: Number of consecutive cycles in which the fingers stood still.
        grasped: The commanded position when the grasp began [%].
    """

    state: GraspState = GraspState.IDLE
    goal: float = 0.0
    commanded: float | None = None
    recent: tuple[float, ...] = ()
    stalls: int = 0
    grasped: float = 0.0

    def next(self, commanded: float, position: float) -> Grasp:
        """Return the state after another cycle.

        The manager runs at 30 Hz. Only closing fingers can touch something. A grasp
        ends with a command to open further than the command that began it. Other
        commands do not change it.

        Args:
            commanded: The commanded position [%].
            position: The measured position [%].
        """
        grasp = self._look(commanded, position)
        state, grasped = self.state, self.grasped
        way = abs(commanded - position)
        match state:
            case GraspState.IDLE if way > _CHANGE:
                state = GraspState.MOVING
            case GraspState.MOVING if grasp.stalls >= _SAMPLES:
                state = GraspState.CONTACT
            case GraspState.MOVING if way < _CHANGE and self._opens(commanded):
                state = GraspState.IDLE
            case GraspState.CONTACT:
                state, grasped = GraspState.GRASPING, commanded
            case GraspState.GRASPING if commanded > grasped + _CHANGE:
                state = GraspState.MOVING
        if state is GraspState.IDLE:
            goal = position
        elif state is GraspState.CONTACT:
            goal = position if self.state is GraspState.MOVING else self.goal
        else:
            goal = commanded
        return dc.replace(
            grasp, state=state, goal=goal, commanded=commanded, grasped=grasped
        )

    def _opens(self, commanded: float) -> bool:
        return self.commanded is not None and commanded > self.commanded

    def _look(self, commanded: float, position: float) -> Grasp:
        """Return this grasp with one more position, and the number of stalls."""
        closed = commanded < _AT_ZERO and position <= _AT_ZERO
        if self.state is not GraspState.MOVING or not (commanded < position or closed):
            return dc.replace(self, stalls=0)
        recent = (*self.recent, position)[-_SAMPLES:]
        spread = max(recent) - min(recent)
        blocked = spread < _STALL and abs(commanded - position) > _BLOCKED
        stalled = blocked or (closed and spread < _STALL_AT_ZERO)
        if len(recent) < _SAMPLES or not stalled:
            return dc.replace(self, recent=recent, stalls=0)
        return dc.replace(self, recent=recent, stalls=self.stalls + 1)


PERIOD = 1.0 / 30.0  # of the driver's cycles [s]
TRAVEL = 2500  # counts from closed to open
_ID = 1
_CURRENT_LIMIT = 1600  # 100 % of force, in units of 3.36 mA
_SETUP = {
    "operating_mode": Mode.CURRENT_BASED_POSITION,
    "current_limit": _CURRENT_LIMIT,
    "velocity_limit": 1023,
    "return_delay_time": 2,
    "torque_enable": 1,
    "profile_velocity": 500,
    "profile_acceleration": 800,
}
# Calibration: goal [%], force [%], and how long the fingers must rest [s].
_BEYOND, _EFFORT, _REST = -300.0, 30.0, 0.5
_STILL = 2  # fingers that move less in a cycle are at rest [counts]
_MIDDLE, _ACCEPTED = 50.0, 10.0  # goal and tolerance of the half-open hand [%]
# Longest time to open half [s]: the servo's profile first comes back from `_BEYOND`.
_SETTLING = 4.0
_FAULT_EFFORT = 10.0  # force of a faulty hand, which goes to the middle [%]


class Phase(enum.Enum):
    """Activities of the driver."""

    CLOSING = "closing"  # finds where the fingers meet
    SETTLING = "settling"  # then opens half
    READY = "ready"
    FAULTY = "faulty"  # until the errors are cleared


@dc.dataclass(frozen=True)
class Reading:
    """Values that the driver read from the servo in a cycle.

    Attributes:
        position: 100 open, 0 closed [%].
        current: The servo's estimate of its current, positive while it closes [A].
        voltage: Voltage of the supply [V].
        temperature: Temperature of the motor [degC].
        error: Bits of the hardware error status.
        moving: Whether the servo moves.
    """

    position: float = _MIDDLE
    current: float = 0.0
    voltage: float = 12.0
    temperature: int = 25
    error: int = 0
    moving: bool = False


class Hand:
    """The driver of one hand, in step with simulated time.

    At the start, it closes until the fingers rest, takes this position as 0 %, and
    opens half. Then it obeys `command` through the grasp manager. After a hardware
    error, the hand opens half and obeys no command until `clear_errors`.

    Attributes:
        ports: Names of the station's output ports whose values `advance` needs.
        phase: The current activity.
        commanded: The last commanded position [%]; None before the first.
        force: The commanded force [% of the current limit].
        zero: Position at which the fingers meet [counts].
        calibrated: Whether the last calibration succeeded.
        reading: The last reading.
    """

    def __init__(self, inbox: CommandInbox, gripper: WiredGripper) -> None:
        self._warn = inbox.warnings.warn
        self._bus = EmulatedBus(inbox, [gripper], Mx64P2, self._warn)
        self._table = self._bus.servos[_ID].table
        self.ports = self._bus.ports
        self.commanded: float | None = None
        self.force, self.zero, self.calibrated = 0.0, 0, False
        self.reading = Reading()
        self._limit: float | None = None  # commanded limit of the force [%]
        self._set_up()
        self.calibrate()
        self._due = 0.0  # time of the next cycle [s]

    def command(self, position: float, limit: float | None = None) -> None:
        """Command a position [%] and a force limit [%]; None: the manager's force."""
        self.commanded, self._limit = position, limit

    def calibrate(self) -> None:
        """Start to find where the fingers meet, and then to open half."""
        self.phase, self.grasp, self.calibrated = Phase.CLOSING, Grasp(), False
        self._still, self._last, self._left = 0.0, math.inf, _SETTLING

    def clear_errors(self) -> None:
        """Reboot the servo, and keep the calibration."""
        self._bus.answer([Packet2(_ID, Instruction.REBOOT)])
        self._set_up()
        self.phase, self.grasp = Phase.READY, Grasp()

    def advance(self, time: float, values: Mapping[str, Vector]) -> bool:
        """Pass the motor's state to the servo; return whether a cycle was due."""
        self._bus.sense(time, values)
        if time < self._due - 1e-9:
            return False
        # Cycles stay on a grid of `PERIOD`, unless the clock has jumped.
        self._due = max(self._due + PERIOD, time)
        self._cycle()
        return True

    def _cycle(self) -> None:
        table = self._table
        counts = table["present_position"]
        self.reading = Reading(
            position=100.0 * (counts - self.zero) / TRAVEL,
            current=-table["present_current"] * table.current_unit,
            voltage=table["present_voltage"] / 10.0,
            temperature=table["present_temperature"],
            error=table["hardware_error_status"],
            moving=bool(table["moving"]),
        )
        if self.reading.error and self.phase is not Phase.FAULTY:
            self.phase = Phase.FAULTY
            fault = Fault(self.reading.error)
            self._warn("dex1 fault", f"hand: {fault}; it waits for action 3")
        match self.phase:
            case Phase.CLOSING:
                self._close(counts)
            case Phase.SETTLING:
                self._settle()
            case Phase.READY:
                self._manage()
            case Phase.FAULTY:
                self._go(_MIDDLE, _FAULT_EFFORT)

    def _close(self, counts: int) -> None:
        still = abs(counts - self._last) < _STILL
        self._still = self._still + PERIOD if still else 0.0
        self._last = counts
        self._go(_BEYOND, _EFFORT)
        if self._still > _REST:
            self.zero, self.phase = counts, Phase.SETTLING

    def _settle(self) -> None:
        self._go(_MIDDLE, FORCES[GraspState.MOVING])
        self._left -= PERIOD
        self.calibrated = abs(self.reading.position - _MIDDLE) <= _ACCEPTED
        if self.calibrated or self._left < 0.0:
            self.phase = Phase.READY
        if not self.calibrated and self._left < 0.0:
            self._warn("dex1 calibration", "hand: has not opened half; calibrate again")

    def _manage(self) -> None:
        position = self.reading.position
        target = position if self.commanded is None else self.commanded
        self.grasp = self.grasp.next(target, position)
        force = FORCES[self.grasp.state]
        self._go(self.grasp.goal, force if self._limit is None else self._limit)

    def _go(self, position: float, force: float) -> None:
        self.force = force
        counts = round(self.zero + TRAVEL * position / 100.0)
        self._write(goal_current=round(_CURRENT_LIMIT * force / 100.0))
        self._write(goal_position=counts)

    def _set_up(self) -> None:
        for name, value in _SETUP.items():
            self._write(**{name: value})

    def _write(self, **values: int) -> None:
        for name, value in values.items():
            register = self._table.register(name)
            address = register.address.to_bytes(2, "little")
            data = value.to_bytes(register.size, "little", signed=value < 0)
            self._bus.answer([Packet2(_ID, Instruction.WRITE, address + data)])
