"""The bridge to clients of a humanoid's hand: SAKE's and Unitree's topics on DDS."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from typing import Any

# Import this first: it says how to install Cyclone DDS if that is missing.
from drake_srg.robot.serve.dex1.messages import (
    MotorCmds,
    MotorState,
    MotorStates,
    String,
)

# isort: split
from cyclonedds.core import DDSException
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from drake_srg.robot.serve.bridge import Bridge
from drake_srg.robot.serve.commands import CommandError, CommandInbox
from drake_srg.robot.serve.dex1.hand import GraspState, Hand, Phase
from drake_srg.robot.serve.dynamixel.bridge import WiredGripper
from drake_srg.types import Vector

SIDES = ("left", "right", "center")
OPEN = 5.4  # angle of an open hand [rad]; a closed one is at 0
_STATE_PERIOD = 1.0 / 200.0  # s
_ERROR = 255  # mode of a faulty hand
_LOST = 2**32 - 1  # value of a faulty hand's counters
_BATCH = 10  # most waiting commands
# QoS of Unitree's SDK, except that a simulation never waits for slow readers.
_WRITES = Qos(
    Policy.Reliability.Reliable(max_blocking_time=0), Policy.History.KeepLast(1)
)
_READS = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(_BATCH))


class Dex1Bridge(Bridge):
    """The topics of one hand, and SAKE's driver behind them.

    Unitree's pair `rt/dex1/SIDE/cmd` and `state` has angles, 0 closed .. 5.4 open
    [rad]; the grasp manager chooses the forces. SAKE's `rt/gripper/SIDE/cmd_direct` and
    `state_direct` have positions and a limit of the force, both in percent. The most
    recent command wins.

    Args:
        participant: A participant in the DDS domain.
        side: "left", "right" or "center".

    Attributes:
        hand: The driver.
    """

    def __init__(
        self,
        participant: DomainParticipant,
        inbox: CommandInbox,
        gripper: WiredGripper,
        side: str,
    ) -> None:
        self._inbox, self._side = inbox, side
        self.hand = Hand(inbox, gripper)
        self.ports = self.hand.ports
        self._due = 0.0

        def reader(name: str, type: Any) -> DataReader[Any]:
            return DataReader(participant, Topic(participant, name, type), qos=_READS)

        def writer(name: str, type: Any) -> DataWriter[Any]:
            return DataWriter(participant, Topic(participant, name, type), qos=_WRITES)

        self._commands: list[tuple[str, DataReader[Any], Callable[[Any], None]]] = [
            (name, reader(name, type), obey)
            for name, type, obey in (
                (f"rt/dex1/{side}/cmd", MotorCmds, self._move),
                (f"rt/gripper/{side}/cmd_direct", String, self._move_directly),
                (f"rt/ezgripper/{side}/admin", String, self._administer),
            )
        ]
        self._state = writer(f"rt/dex1/{side}/state", MotorStates)
        self._direct = writer(f"rt/gripper/{side}/state_direct", String)
        self._telemetry = writer(f"rt/gripper/{side}/telemetry", String)
        self._status = writer(f"rt/ezgripper/{side}/state", String)

    @property
    def status(self) -> str:
        """The hand's topics, as text for the status line."""
        return f"{self._side} hand at rt/dex1/{self._side}, {self.hand.phase.value}"

    def update(self, time: float, values: Mapping[str, Vector]) -> None:
        """Receive the values of `ports` at a time [s]; called every control period."""
        try:
            for name, reader, obey in self._commands:
                for sample in reader.take(_BATCH):
                    self._receive(name, obey, sample)
            cycled = self.hand.advance(time, values)
            if time >= self._due - 1e-9:
                self._due = max(self._due + _STATE_PERIOD, time)
                self._state.write(MotorStates(states=[self._motor_state()]))
            if cycled:
                status = self._report(time)
                self._direct.write(String(data=json.dumps(self._direct_state())))
                self._telemetry.write(String(data=json.dumps(status)))
                self._status.write(String(data=json.dumps(status)))
        except DDSException:  # closed, or too many messages are unconfirmed
            return

    # Commands.

    def _receive(self, name: str, obey: Callable[[Any], None], sample: Any) -> None:
        if not sample.sample_info.valid_data:  # the writer has left
            return
        try:
            obey(sample)
        except CommandError as error:
            self._inbox.refuse(name, error.kind, str(error))
        else:
            self._inbox.count()

    def _move(self, message: Any) -> None:
        if not message.cmds:
            raise CommandError("length", "needs a motor command, got none")
        angle = message.cmds[0].q
        if not math.isfinite(angle):
            raise CommandError("finite", f"q must be a finite number, got {angle}")
        self.hand.command(100.0 * min(max(angle / OPEN, 0.0), 1.0))

    def _move_directly(self, message: Any) -> None:
        values = _json_object(message.data)
        self.hand.command(
            _percent(values, "position_pct"), _percent(values, "force_limit_pct")
        )

    def _administer(self, message: Any) -> None:
        match _json_object(message.data).get("action"):
            case 0 | 1:
                pass  # 0 asks for nothing, 1 for the state, which comes at 30 Hz anyway
            case 2:
                self.hand.calibrate()
            case 3:
                self.hand.clear_errors()
            case action:
                raise CommandError("action", f"action must be 0 to 3, got {action!r}")

    # States.

    def _motor_state(self) -> Any:
        hand, reading = self.hand, self.hand.reading
        if hand.phase is Phase.FAULTY:
            angle, effort, mode, temperature, lost = 0.0, 0.0, _ERROR, 0, _LOST
        else:
            angle = OPEN * min(max(reading.position / 100.0, 0.0), 1.0)
            effort, mode, lost = hand.force / 10.0, int(hand.grasp.state), 0
            temperature = reading.temperature
        return MotorState(
            mode=mode,
            q=angle,
            dq=0.0,
            ddq=0.0,
            tau_est=effort,
            q_raw=angle,
            dq_raw=0.0,
            ddq_raw=0.0,
            temperature=temperature,
            lost=lost,
            reserve=[lost, lost],
        )

    def _direct_state(self) -> dict[str, Any]:
        hand = self.hand
        return {
            "position_pct": round(hand.reading.position, 2),
            "force_limit_pct": hand.force,
            "state": hand.grasp.state.name.lower(),
        }

    def _report(self, time: float) -> dict[str, Any]:
        hand, reading = self.hand, self.hand.reading
        state = hand.grasp.state
        faulty = hand.phase is Phase.FAULTY
        touches = state in (GraspState.CONTACT, GraspState.GRASPING)
        actual = round(reading.position, 2)
        commanded = actual if hand.commanded is None else round(hand.commanded, 2)
        return {
            "timestamp": round(time, 4),
            "pos": f"{actual:.1f}%",
            "state": "error" if faulty else state.name.lower(),
            "contact": touches,
            "position": {"actual_pct": actual, "commanded_pct": commanded},
            "effort": {"actual_pct": hand.force},
            "grasp_manager": {
                "state": state.name.lower(),
                "state_name": state.name,
                "contact_detected": touches,
            },
            "hardware": {
                "temperature_c": reading.temperature,
                "current_ma": round(1e3 * abs(reading.current)),
                "voltage_v": reading.voltage,
                "error": reading.error,
                "error_code": reading.error,
            },
            "calibration": {"is_calibrated": hand.calibrated, "offset": hand.zero},
            "health": {"is_moving": reading.moving, "contact_detected": touches},
            "error_recovery": {"available": faulty},
        }


def _json_object(text: str) -> dict[str, Any]:
    try:
        values = json.loads(text)
    except ValueError:
        values = None
    if not isinstance(values, dict):
        raise CommandError("json", f"must be a JSON object, got {text[:60]!r}")
    return values


def _percent(values: Mapping[str, Any], key: str) -> float:
    value: Any = values.get(key)
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not 0.0 <= value <= 100.0:
        raise CommandError(key, f"{key} must be 0 to 100, got {value!r}")
    return float(value)
