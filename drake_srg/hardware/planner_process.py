"""Localizer and planner in a process of their own.

Both take long: images tenths of a second, plans seconds. In the process of the control
loop they would hold it up, whatever thread they are in. So they run as a cell of their
own, see `planner_cell`.
"""

from __future__ import annotations

import contextlib
import threading
import time as wall
from collections import deque
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from typing import Any

from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from drake_srg.bridges.commands import PortValues, Warnings
from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.common.processes import Companion
from drake_srg.common.real_time import lower_priority
from drake_srg.hardware.config import HardwareConfig
from drake_srg.hardware.exchange import Answer, Ended, PlannerLink, Tick
from drake_srg.hardware.opening import Hardware, open_cameras
from drake_srg.hardware.planner_cell import MirrorLink, PlannerCell
from drake_srg.scenario import Scenario

# Ticks under way. More would let the planner's clock run behind the robot's, fewer
# would leave it waiting for each message.
_UNDER_WAY = 2
_POLL = 0.1  # s
_UNEXPECTED = Ended("the planner's process has ended unexpectedly")


class PlannerProcess(PlannerLink):
    """Runs the localizer and the planner of a scenario in a process.

    Args:
        scenario: That runs on the hardware.
        config: Of the drivers; the process opens the cameras.
        outputs: Sizes of the measurements in the ticks, by name.
        start: The first measurements.
        warnings: Where the process's warnings are reported.
    """

    def __init__(
        self,
        scenario: Scenario,
        config: HardwareConfig,
        outputs: dict[str, int],
        start: PortValues,
        warnings: Warnings,
    ) -> None:
        self._warnings = warnings
        self._answers: deque[Answer | Ended] = deque()
        self._under_way = 0
        self._ready = threading.Event()
        self.planning_wall = 0.0  # what planning has taken there [s]
        # Drake's schema objects do not pickle, but their YAML does.
        texts = (yaml_dump_typed(scenario), yaml_dump_typed(config))
        self._process = Companion(
            "planner",
            _run,
            (*texts, outputs, dict(start)),
            self._receive,
            lambda: self._receive(_UNEXPECTED),
        )

    def wait(self, patience: float, stopped: Callable[[], bool]) -> None:
        """Wait until the planner is ready for ticks.

        Args:
            patience: How long [s, real].
            stopped: Whether to give up waiting.

        Raises:
            ScenarioError: If it does not get ready.
        """
        end = wall.monotonic() + patience
        while not self._ready.wait(_POLL):
            if stopped():
                raise ScenarioError("hardware: stopped before the planner was ready")
            if wall.monotonic() > end:
                raise ScenarioError(
                    f"hardware: the planner is not ready after {patience:g} s"
                )
        for message in self.take():
            if isinstance(message, Ended):
                raise ScenarioError(message.reason)

    def post(self, tick: Tick) -> None:
        """See `PlannerLink`."""
        if self._under_way < _UNDER_WAY:
            self._under_way += 1
            self._process.send(tick)

    def take(self) -> Sequence[Answer | Ended]:
        """See `PlannerLink`."""
        taken = []
        while self._answers:
            taken.append(self._answers.popleft())
        self._under_way -= sum(isinstance(message, Answer) for message in taken)
        return taken

    def close(self) -> None:
        """End the process."""
        self._process.close()

    def _receive(self, message: str | Answer | Ended | None) -> None:
        if isinstance(message, str):
            self._warnings.warn(message, message)
            return
        if message is not None:
            self._answers.append(message)
        if isinstance(message, Answer):
            self.planning_wall = message.planning_wall
        if not isinstance(message, Answer):  # None: ready
            self._ready.set()


def _run(
    connection: Connection,
    scenario_text: str,
    hardware_text: str,
    outputs: dict[str, int],
    start: PortValues,
) -> None:
    """Run the process: answer ticks until the connection or the planner ends."""
    lower_priority()
    sending = threading.Lock()  # warnings come from any thread

    def send(message: Any) -> None:
        with sending:
            connection.send(message)

    try:
        scenario = yaml_load_typed(schema=Scenario, data=scenario_text)
        config = yaml_load_typed(schema=HardwareConfig, data=hardware_text)
        warnings = Warnings(send)
        with open_cameras(scenario, config, warnings) as cameras:
            hardware = Hardware([MirrorLink(outputs)], cameras, start)
            cell = PlannerCell(scenario, hardware)
            send(None)  # ready
            while True:
                send(cell.answer(connection.recv()))
    except (EOFError, OSError) as error:
        reason = one_line(error)
    except Exception as error:  # the robot must not be left without a word
        reason = one_line(error) or repr(error)
    with contextlib.suppress(OSError):  # the control loop is gone
        send(Ended(reason))
