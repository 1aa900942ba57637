"""Opens the bridges that a user asks for, including the keyboard."""

import contextlib
import dataclasses as dc
import os
import re
import signal
import termios
import tty
from collections.abc import Sequence
from typing import TYPE_CHECKING

from drake_srg.common.exceptions import ScenarioError
from drake_srg.config import Config
from drake_srg.recording.rosbag import Topic
from drake_srg.robot.serve.bridge import Bridge
from drake_srg.robot.serve.commands import CommandInbox
from drake_srg.robot.serve.sockets import IoThread
from drake_srg.scenario import Scenario
from drake_srg.scenario.schema import check_single_arm

if TYPE_CHECKING:
    from cyclonedds.domain import DomainParticipant

# Topics and data by key.
_KEYS = {
    "e": [("/estop", True)],
    "r": [("/estop", False), ("/release", True)],
}


class KeyboardBridge(Bridge):
    """Commands a safety monitor by keys: `e` stops the arm, `r` releases it.

    Until the bridge is closed, the terminal does not echo keys and passes them on at
    once. Ctrl-C keeps its meaning.

    Args:
        inbox: Receives the commands.
        terminal: File descriptor of the terminal.
    """

    def __init__(self, inbox: CommandInbox, terminal: int) -> None:
        self._inbox, self._terminal = inbox, terminal
        self._before = termios.tcgetattr(terminal)
        tty.setcbreak(terminal)
        self._io = IoThread("keys")
        self._io.post(self._io.loop.add_reader, terminal, self._read)

    @property
    def status(self) -> str:
        """The keys, as text for the status line."""
        return "keys e stop, r release"

    @property
    def closed(self) -> bool:
        """True: once clients have closed all other bridges, the station must end."""
        return True

    def close(self) -> None:
        """Restore the terminal's settings. A second call does nothing."""
        if self._io.loop.is_closed():
            return
        self._io.stop()
        # In a background process, tcsetattr sends a signal that would stop the process.
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTTOU])
        with contextlib.suppress(termios.error):  # the terminal is gone
            termios.tcsetattr(self._terminal, termios.TCSADRAIN, self._before)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)

    def _read(self) -> None:
        try:
            typed = os.read(self._terminal, 64)
        except OSError:  # the terminal is gone
            typed = b""
        if not typed:
            self._io.loop.remove_reader(self._terminal)
        for key in typed.decode(errors="ignore"):
            for topic, data in _KEYS.get(key, ()):
                self._inbox.receive(topic, data)


def own_terminal(stream: object) -> int | None:
    """Return the descriptor of a stream if this process may read keys from it."""
    try:
        descriptor: int = stream.fileno()  # type: ignore[attr-defined]  # or no file
        foreground = os.tcgetpgrp(descriptor) == os.getpgrp()
    except (AttributeError, OSError, ValueError):  # no file, or no terminal
        return None
    return descriptor if foreground else None


@dc.dataclass(kw_only=True)
class Ros1Config(Config):
    """Configuration of a ROS 1 node."""

    # URI of the master; empty: $ROS_MASTER_URI.
    master: str = ""
    # Address of this machine that peers can reach, and the node's name.
    host: str = "127.0.0.1"
    name: str = "drake_srg_hardware"

    def open(self, inbox: CommandInbox, topics: Sequence[Topic]) -> Bridge:
        """Return the node; see `Ros1Bridge`."""
        from drake_srg.robot.serve.ros1.bridge import Ros1Bridge

        name, master = f"/{self.name}", self.master or None
        return Ros1Bridge(inbox, topics, master=master, host=self.host, name=name)


@dc.dataclass(kw_only=True)
class Ros2Config(Config):
    """Configuration of a ROS 2 participant."""

    # Number of the domain; null: $ROS_DOMAIN_ID.
    domain: int | None = dc.field(default=None, metadata={"ge": 0, "le": 232})
    # Address of this machine that peers can reach, and the participant's name.
    host: str = "127.0.0.1"
    name: str = "drake_srg_hardware"

    def open(self, inbox: CommandInbox, topics: Sequence[Topic]) -> Bridge:
        """Return the participant; see `Ros2Bridge`."""
        from drake_srg.robot.serve.ros2.bridge import Ros2Bridge

        domain, host = self.domain, self.host
        return Ros2Bridge(inbox, topics, domain=domain, interface=host, name=self.name)


@dc.dataclass(frozen=True)
class BridgeOptions:
    """The bridges of a station and their addresses.

    Attributes:
        ros1: Whether to open a ROS 1 node.
        master: URI of the ROS 1 master; None: from the environment.
        ros2: Whether to open a ROS 2 node.
        domain: ROS 2 domain; None: from the environment.
        servo: Address of the servos' bus, tcp:PORT, tcp:HOST:PORT or pty; None: no
            servos.
        protocol: Dynamixel protocol of the servos, 1 or 2; None: 1.
        dex1: Side of a humanoid whose hand the gripper is, such as "left"; None: no
            topics of such a hand.
        participant: Participant in the DDS domain of the hand's topics.
        host: Address of this machine that peers can reach.
        name: Name of the nodes.
        terminal: Descriptor of a terminal whose keys command the safety monitor, if the
            station has one; None: no keys.
    """

    ros1: bool = False
    master: str | None = None
    ros2: bool = False
    domain: int | None = None
    servo: str | None = None
    protocol: int | None = None
    dex1: str | None = None
    participant: "DomainParticipant | None" = None
    host: str = "127.0.0.1"
    name: str = "drake_srg"
    terminal: int | None = None

    def connect(
        self, scenario: Scenario, inbox: CommandInbox, topics: Sequence[Topic]
    ) -> Sequence[Bridge]:
        """Return the bridges to a scenario's station.

        Raises:
            ScenarioError: If an option is invalid, or the station has no servos.
            OSError: If an address is in use.
            ImportError: If a package is missing.
        """
        bridges: list[Bridge] = []
        with contextlib.ExitStack() as stack:

            def add(bridge: Bridge) -> None:
                stack.callback(bridge.close)
                bridges.append(bridge)

            try:
                if not re.fullmatch("[A-Za-z][A-Za-z0-9_]*", self.name):
                    raise ValueError(
                        "--name: must be a letter, then letters, digits and "
                        f"underscores, got {self.name!r}"
                    )
                host, name = self.host, self.name
                if self.ros1:
                    ros1 = Ros1Config(master=self.master or "", host=host, name=name)
                    add(ros1.open(inbox, topics))
                if self.ros2:
                    ros2 = Ros2Config(domain=self.domain, host=host, name=name)
                    add(ros2.open(inbox, topics))
                if self.terminal is not None and "/estop" in inbox.topics:
                    add(KeyboardBridge(inbox, self.terminal))
                if self.protocol is not None and self.servo is None:
                    raise ValueError("--protocol: needs --servo")
                for option in ("servo", "dex1"):
                    if getattr(self, option) is not None:
                        check_single_arm(scenario, f"--{option}")
                if self.servo is not None:
                    from drake_srg.robot.serve.dynamixel.bridge import (
                        ServoBridge,
                        station_mechanisms,
                    )

                    protocol = 1 if self.protocol is None else self.protocol
                    mechanisms = station_mechanisms(scenario)
                    add(ServoBridge(inbox, self.servo, mechanisms, protocol))
                if self.dex1 is not None and self.participant is not None:
                    from drake_srg.robot.serve.dex1.bridge import Dex1Bridge
                    from drake_srg.robot.serve.dynamixel.bridge import WiredGripper

                    gripper = scenario.gripper
                    motor = None if gripper is None else gripper.wire_motor
                    if motor is None:
                        raise ValueError(
                            "--dex1: needs a gripper with a wire motor "
                            "(!SrgTendonDriver, as in gripper_bench)"
                        )
                    hand = WiredGripper(motor)
                    add(Dex1Bridge(self.participant, inbox, hand, self.dex1))
            except ValueError as error:
                raise ScenarioError(f"serve: {error}") from error
            stack.pop_all()
        return bridges
