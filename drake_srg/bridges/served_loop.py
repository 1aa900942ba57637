"""The loop of a served station."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

from drake_srg.bridges.action_server import ActionServer
from drake_srg.bridges.commands import (
    CommandInbox,
    CommandTopic,
    Warnings,
    station_topics,
)
from drake_srg.bridges.outlet import Outlet
from drake_srg.bridges.safety_commands import SafetyGate, safety_topics
from drake_srg.bridges.served_replay import ServedReplay
from drake_srg.bridges.trajectory_topics import TRAJECTORY, trajectory_topics
from drake_srg.common.ports import input_ports, output_ports
from drake_srg.lifetime import my_context
from drake_srg.recording.ros_topics import Topic
from drake_srg.scenario import Scenario
from drake_srg.simulation import failure_time
from drake_srg.station.sleeping import Advance
from drake_srg.types import Vector


def control_period(scenario: Scenario) -> float:
    """Return the time between reads of the inbox [s]: the arm driver's period."""
    if scenario.arm is not None:
        return scenario.arm.period
    return scenario.plant_config.time_step or 1.0 / 256.0


def MakeActionServer(scenario: Scenario, station: Diagram) -> ActionServer | None:
    """Return the action server of an arm that follows trajectories, else None."""
    if TRAJECTORY not in input_ports(station):
        return None
    plant = station.GetSubsystemByName("station").GetSubsystemByName("plant")
    return ActionServer(plant, control_period(scenario))


def station_inbox(
    scenario: Scenario,
    station: Diagram,
    warnings: Warnings,
    others: Iterable[CommandTopic] = (),
) -> CommandInbox:
    """Return the inbox for all commands that a served station obeys.

    Args:
        scenario: The scenario.
        station: Of `MakeServedStation`.
        warnings: Where refused commands are reported.
        others: Topics besides those that command input ports.
    """
    joints = () if scenario.gripper is None else scenario.gripper.joint_names
    plant = station.GetSubsystemByName("station").GetSubsystemByName("plant")
    inputs = input_ports(station)
    commands = station_topics(plant, inputs, joints)
    commands += trajectory_topics(plant, inputs, control_period(scenario))
    return CommandInbox([*commands, *safety_topics(inputs), *others], warnings)


def fix_defaults(station: Diagram, context: Context) -> None:
    """Open the gripper until somebody commands it: these ports need a value."""
    for name in ("gripper.closure_commanded", "gripper.closure_messages"):
        if station.HasInputPort(name):
            station.GetInputPort(name).FixValue(context, [0.0])


class Shown(Protocol):
    """Publishes pictures, such as `Pictures`."""

    def look(
        self, time: float, plant_state: Callable[[], Vector], outlet: Outlet
    ) -> None:
        """Publish what the cameras see of the plant's state at a time [s]."""


class ServedLoop:
    """Advances a served station: commands in, one control period, messages out.

    Args:
        name: The scenario's.
        simulator: Of the root, initialized.
        advance: Advances it.
        station: Of `MakeServedStation`.
        topics: What to publish.
        pictures: The same of the cameras.
        inbox: Where commands arrive.
        outlet: Publishes.
        replay: What is sampled for the replay, if anything.
        actions: The arm's action server, connected, if it has one.
    """

    def __init__(
        self,
        name: str,
        simulator: Simulator,
        advance: Advance,
        station: Diagram,
        topics: Sequence[Topic],
        pictures: Shown,
        inbox: CommandInbox,
        outlet: Outlet,
        replay: ServedReplay | None = None,
        actions: ActionServer | None = None,
    ) -> None:
        self._replay, self._actions = replay, actions
        self._name, self._simulator, self._advance = name, simulator, advance
        self.inbox, self.outlet = inbox, outlet
        self._topics, self._pictures = topics, pictures
        self._root = simulator.get_mutable_context()
        self._station = station
        self._context = my_context(station, self._root)
        self._ports = output_ports(station)
        self._gate = SafetyGate(station, inbox.warnings)
        # The integrator of a continuous plant chooses its own steps: there, a control
        # period counts as one.
        self._plant = station.GetSubsystemByName("station").GetSubsystemByName("plant")
        self._plant_step = self._plant.time_step() or math.inf
        self._wanted = sorted({name for b in outlet.bridges for name in b.ports})

    def advance(self, until: float) -> None:
        """Apply the commands, advance to a time [s] and publish.

        Messages go out after the plant's first step, which already shows the effect of
        the commands. The remaining steps of the control period take real time, for
        which clients would otherwise wait.
        """
        if self._actions is not None:
            self._actions.advance(
                self._root.get_time(),
                self._value("arm.state_measured"),
                self._value("arm.position_commanded"),
            )
        for name, value in self._gate.admit(self.inbox.take(), self._context).items():
            self._station.GetInputPort(name).FixValue(self._context, value)
        time = min(self._root.get_time() + self._plant_step, until)
        self._advance_to(time)
        values = {name: self._value(name) for name in self._wanted}
        self.outlet.update(time, values)
        for topic in self._topics:
            if self.outlet.has_subscribers(topic.name):
                payload = [self._value(name) for name in topic.ports]
                self.outlet.send(topic, time, payload)
        self._pictures.look(time, self._plant_state, self.outlet)
        if time < until:  # CENIC takes no step of zero length
            self._advance_to(until)
        if self._replay is not None:
            self._replay.sample(self._root)

    def _advance_to(self, time: float) -> None:
        with failure_time(self._name, self._simulator):
            self._advance(time)

    def _plant_state(self) -> Vector:
        context = self._plant.GetMyContextFromRoot(self._root)
        return np.array(self._plant.get_state_output_port().Eval(context))

    def _value(self, name: str) -> Any:
        port = self._ports.get(name)
        return None if port is None else port.Eval(self._context)
