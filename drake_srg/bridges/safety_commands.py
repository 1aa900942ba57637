"""Commands from clients to a served station's safety monitor."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from pydrake.systems.framework import Context, Diagram

from drake_srg.bridges.commands import (
    CommandError,
    CommandTopic,
    PortValues,
    Warnings,
)
from drake_srg.bridges.trajectory_topics import TRAJECTORY
from drake_srg.common.safety_states import SafetyState, safety_state

_ARM_PORTS = ("arm.position_desired", TRAJECTORY)
_BOOL = "std_msgs/msg/Bool"


_SWITCHES = ("estop", "release", "heartbeat")


def safety_topics(
    inputs: Iterable[str], switches: Sequence[str] = _SWITCHES
) -> list[CommandTopic]:
    """Return the topics that command a station's safety monitor, if it has one.

    `/estop` (Bool, true while the button is pressed), `/release` (Bool, true
    acknowledges a stop), `/speed_override` (Int32, 0 .. 100 %) and `/heartbeat` (Bool;
    from the first true until a false, the arm stops unless more of them arrive).

    Args:
        inputs: Names of the station's input ports.
        switches: Which of the Bool topics there are.
    """
    if "safety.estop" not in inputs:
        return []

    def override(data: Any) -> PortValues:
        percent = int(data)
        if not 0 <= percent <= 100:
            raise CommandError("range", f"must be 0 to 100 percent, got {percent}")
        return {"safety.speed_override": np.array([percent / 100.0])}

    def switch(name: str) -> CommandTopic:
        def convert(data: Any) -> PortValues:
            return {f"safety.{name}": np.array([1.0 if data else 0.0])}

        return CommandTopic(f"/{name}", _BOOL, convert, latched=name == "estop")

    return [
        *(switch(name) for name in switches),
        CommandTopic("/speed_override", "std_msgs/msg/Int32", override),
    ]


class SafetyGate:
    """Keeps a stopped arm's commands away, so that no old one moves it once released.

    A station without a safety monitor gets its commands unchanged.

    Args:
        station: The served station.
        warnings: Where stops are reported.
    """

    def __init__(self, station: Diagram, warnings: Warnings) -> None:
        self._warnings = warnings
        self._state = None
        if station.HasOutputPort("safety.state"):
            self._state = station.GetOutputPort("safety.state")
            (self._arm,) = filter(station.HasInputPort, _ARM_PORTS)
            self._nowhere = np.full(station.GetInputPort(self._arm).size(), np.nan)

    def admit(self, values: PortValues, context: Context) -> PortValues:
        """Return the values of input ports to set.

        Args:
            values: Commands since the last call, by input port.
            context: The station's.
        """
        if self._state is None:
            return values
        # A release counts once.
        values = {"safety.release": np.zeros(1), **values}
        if "safety.heartbeat" in values:
            beats = values["safety.heartbeat"][0] > 0.0
            time = context.get_time() if beats else np.inf
            values["safety.heartbeat"] = np.array([time])
        state, reason = safety_state(self._state.Eval(context))
        if state is SafetyState.RUNNING:
            self._warnings.forget("stop")
            return values
        self._warnings.warn(
            "stop", f"the arm is stopped ({reason.value}); /kuka waits for a /release"
        )
        return {**values, self._arm: self._nowhere}
