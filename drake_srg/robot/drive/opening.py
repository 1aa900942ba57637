"""Connects to the hardware that a hardware file describes."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import functools
import time as wall
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from typing import Any

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.robot.drive.cameras import Camera
from drake_srg.robot.drive.config import FaultyLink, HardwareConfig
from drake_srg.robot.drive.link import (
    EXTERNAL_TORQUE,
    HardwareDriver,
    Link,
    NamedLink,
    Node,
    Nodes,
    Robot,
    RosDriver,
)
from drake_srg.robot.serve.commands import (
    CommandInbox,
    PortValues,
    Warnings,
    arm_joint_names,
    port_of,
)
from drake_srg.robot.serve.loop import control_period
from drake_srg.scenario import Scenario, robot_arms, servo_of
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Vector

# Measurements to wait for, if links have them: planner and safety monitor need them.
_NEEDED = ("arm.state_measured", "gripper.state_measured", EXTERNAL_TORQUE)
_POLL = 0.02  # s


@dc.dataclass(frozen=True)
class Hardware:
    """A robot's live connections, and its first measurements.

    Attributes:
        start: The first measurements, by the station's output port.
    """

    links: Sequence[Link]
    cameras: Mapping[str, Camera]
    start: PortValues

    @property
    def lag(self) -> float:
        """Time within which the slowest part must reach a commanded position [s]."""
        return max((link.lag for link in self.links), default=0.0)


@contextlib.contextmanager
def open_hardware(
    scenario: Scenario,
    config: HardwareConfig,
    warnings: Warnings,
    *,
    inbox: CommandInbox | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> Iterator[Hardware]:
    """Connect to arms and grippers, and wait for their first measurements.

    Args:
        scenario: The scenario to run on the hardware.
        config: The drivers.
        warnings: Receives warnings.
        inbox: Receives the user's commands: if any part of the robot speaks ROS, a node
            subscribes to the inbox's topics.
        stopped: Returns whether to give up waiting.

    Raises:
        ScenarioError: If the drivers do not fit the scenario, or nothing arrives.
        OSError: If an address is in use, or the hardware cannot be reached.
        ImportError: If a package is missing.
    """
    check_arms(scenario, config)
    with contextlib.ExitStack() as stack:
        robots = MakeRobots(scenario, config, warnings)
        nodes = robots[0].nodes
        stack.callback(nodes.close)  # after the links, which may still send
        parts = [
            (robot, part, driver)
            for robot in robots
            for part, driver in (
                ("arm", config.drivers[robot.own.name].arm),
                ("gripper", config.drivers[robot.own.name].gripper),
            )
        ]
        links: list[Link] = []
        for robot, _, driver in parts:
            with robot.own.named_errors():
                link = driver.connect(robot)
            stack.callback(link.close)
            link = NamedLink(link, robot.own)
            if config.faults is not None:
                link = FaultyLink(link, config.faults, control_period(scenario))
            links.append(link)
        _check_topics(parts)
        if inbox is not None:
            for version in config.ros_versions:
                _subscribe(nodes.of(version), inbox)
        nodes.open()
        needed = {port_of(robot.own, name) for robot in robots for name in _NEEDED}
        yield Hardware(links, {}, _first(links, needed, config.patience, stopped))


def check_arms(scenario: Scenario, config: HardwareConfig) -> None:
    """Raise a ScenarioError unless scenario and hardware file have the same arms."""
    arms = robot_arms(scenario)
    if not all(own.arm and own.gripper for own in arms):
        raise ScenarioError("hardware: the scenario needs an arm and a gripper")
    for own in arms:
        if own.name not in config.drivers:
            missing = f"hardware: {own.key}arm: missing, but the scenario has this arm"
            raise ScenarioError(missing)
    for name in config.drivers.keys() - {own.name for own in arms}:
        raise ScenarioError(
            f"hardware: arms.{name}: the scenario has no such arm (allowed: "
            f"{', '.join(own.name for own in arms)})"
        )


def _check_topics(parts: Iterable[tuple[Robot, str, HardwareDriver]]) -> None:
    """Raise a ScenarioError if two drivers share a topic of their own, or a joint."""
    users: dict[tuple[int, str, str], str] = {}
    for robot, part, driver in parts:
        if not isinstance(driver, RosDriver):
            continue
        topics = [(key, getattr(driver, key), "") for key in driver.own_topics]
        joints = [("state", driver.state, joint) for joint in driver.names(robot)]
        for key, given, joint in (*topics, *joints):
            topic, place = robot.topic(given), f"{robot.own.key}{part}.{key}"
            user = users.setdefault((driver.version, topic, joint), place)
            if topic and user != place:
                what = f"{joint} in {topic}" if joint else topic
                raise ScenarioError(f"hardware: {place}: {user} has {what}, too")


def _subscribe(node: Node, inbox: CommandInbox) -> None:
    """Subscribe a node to the topics of an inbox, which receives their messages."""
    for topic in inbox.topics.values():
        node.subscribe(
            topic.name, topic.type, functools.partial(inbox.receive_message, topic.name)
        )


@contextlib.contextmanager
def open_cameras(
    scenario: Scenario, config: HardwareConfig, warnings: Warnings
) -> Iterator[Mapping[str, Camera]]:
    """Connect to the cameras that the task needs, and wait for a picture of each.

    Raises:
        ScenarioError: If a camera is missing from the hardware file, does not fit the
            scenario, or sends nothing.
        OSError: If an address is in use.
        ImportError: If a package is missing.
    """
    robot = MakeRobot(scenario, config, warnings, "_cameras")
    with contextlib.closing(robot.nodes):
        cameras = {}
        users = dict.fromkeys(scenario.localizer.cameras, "localizer")
        for name in scenario.task.place.cameras:
            users.setdefault(name, "planner (task.place.cameras)")
        servo = servo_of(scenario)
        if servo is not None:
            users[servo.camera] = "visual servo"
        for name, user in users.items():
            if name not in config.cameras:
                raise ScenarioError(
                    f"hardware: cameras.{name}: missing, but the {user} needs it"
                )
            cameras[name] = config.cameras[name].connect(name, robot)
        robot.nodes.open()
        for camera in cameras.values():
            camera.picture(-np.inf, config.patience)
        yield cameras


def MakeRobot(
    scenario: Scenario, config: HardwareConfig, warnings: Warnings, suffix: str = ""
) -> Robot:
    """Return the first of `MakeRobots`."""
    return MakeRobots(scenario, config, warnings, suffix)[0]


def MakeRobots(
    scenario: Scenario, config: HardwareConfig, warnings: Warnings, suffix: str = ""
) -> list[Robot]:
    """Return a `Robot` for each arm of a scenario; they share nodes, not yet open.

    Args:
        scenario: The scenario to run on the hardware.
        config: The nodes' configuration.
        warnings: Receives warnings.
        suffix: Added to the nodes' names, which must differ between processes.
    """
    plant = MakeModelsPlant(scenario)
    nodes, shared = Nodes(config.ros1, config.ros2, warnings, suffix), dict[Any, Any]()
    return [
        Robot(
            dc.replace(
                scenario, arms={}, arm=own.arm, gripper=own.gripper, safety=own.safety
            ),
            tuple(arm_joint_names(plant, own)),
            warnings,
            nodes,
            shared,
            own,
        )
        for own in robot_arms(scenario)
    ]


def _first(
    links: Sequence[Link],
    needed: Set[str],
    patience: float,
    stopped: Callable[[], bool],
) -> PortValues:
    """Return the first measurements, once the needed ones have arrived."""
    needed = {name for link in links for name in link.outputs} & needed
    found: dict[str, Vector] = {}
    end = wall.monotonic() + patience
    while needed - found.keys():
        if stopped():
            raise ScenarioError("hardware: stopped before anything arrived")
        if wall.monotonic() > end:
            missing = ", ".join(sorted(needed - found.keys()))
            raise ScenarioError(
                f"hardware: no {missing} within {patience:g} s: does the robot run, "
                "and are the topics, the domain and the joints' names right?"
            )
        wall.sleep(_POLL)
        for link in links:
            found |= link.take()
    return found
