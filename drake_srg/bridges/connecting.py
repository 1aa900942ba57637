"""Which bridges there are, and how they are made."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import re
from collections.abc import Sequence

from drake_srg.bridges.bridge import Bridge
from drake_srg.bridges.commands import CommandInbox
from drake_srg.common.errors import ScenarioError
from drake_srg.gripper.drivers import SrgTendonDriver
from drake_srg.recording.ros_topics import Topic
from drake_srg.scenario import Scenario


@dc.dataclass(frozen=True)
class BridgeOptions:
    """What somebody asks for who wants to command a station from outside."""

    ros1: bool = False
    master: str | None = None  # URI; None: as ROS 1 finds it
    ros2: bool = False
    domain: int | None = None  # None: as ROS 2 finds it
    servo: str | None = None  # tcp:PORT, tcp:HOST:PORT or pty; None: no servo
    host: str = "127.0.0.1"  # address of this machine that peers reach
    name: str = "drake_srg"  # of the node

    def connect(
        self, scenario: Scenario, inbox: CommandInbox, topics: Sequence[Topic]
    ) -> Sequence[Bridge]:
        """Make the bridges to a scenario's station.

        Raises:
            ScenarioError: If an option's value is none, or the gripper has no servo.
            OSError: If an address is taken.
            ImportError: If a package is missing.
        """
        bridges: list[Bridge] = []
        with contextlib.ExitStack() as stack:

            def add(bridge: Bridge) -> None:
                stack.callback(bridge.close)
                bridges.append(bridge)

            # Imported where they are made: their packages are optional.
            try:
                if not re.fullmatch("[A-Za-z][A-Za-z0-9_]*", self.name):
                    raise ValueError(
                        f"--name {self.name}: must be letters, digits and underscores, "
                        "a letter first"
                    )
                if self.ros1:
                    from drake_srg.bridges.ros1.bridge import Ros1Bridge

                    add(
                        Ros1Bridge(
                            inbox,
                            topics,
                            master=self.master,
                            host=self.host,
                            name=f"/{self.name}",
                        )
                    )
                if self.ros2:
                    from drake_srg.bridges.ros2.bridge import Ros2Bridge

                    add(
                        Ros2Bridge(
                            inbox,
                            topics,
                            domain=self.domain,
                            interface=self.host,
                            name=self.name,
                        )
                    )
                if self.servo is not None:
                    from drake_srg.bridges.dynamixel.bridge import ServoBridge

                    if not isinstance(scenario.gripper, SrgTendonDriver):
                        raise ValueError(
                            "--servo: needs a gripper with a motor of its own, "
                            "!SrgTendonDriver, as kitchen_tendon has"
                        )
                    add(ServoBridge(inbox, self.servo, scenario.gripper))
            except ValueError as error:
                raise ScenarioError(f"serve: {error}") from error
            stack.pop_all()
        return bridges
