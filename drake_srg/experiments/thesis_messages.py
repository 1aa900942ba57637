"""The SRG thesis's demonstration, commanded by messages over ROS 1 and ROS 2.

A client in a separate process sends the thesis's 5752 messages at the thesis's pace to
a station that is served in real time. A witness, which reads the ground truth and
commands nothing, records the motion of the can.
"""

from __future__ import annotations

import dataclasses as dc
import multiprocessing as mp
import threading
import time as wall
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from drake_srg.experiments.bridge_client import Client, MakeBridge, open_wire
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.recording.rosbag import Topic
from drake_srg.recording.timeline import make_figure, style_axes
from drake_srg.robot.serve.bridge import Bridge
from drake_srg.robot.serve.commands import CommandInbox
from drake_srg.robot.serve.loop import Serve, Served
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.scenario.schema import script_of
from drake_srg.theses.script import MessagesConfig, Script
from drake_srg.types import Vector

# One wire per driver is enough, because drivers and wires do not affect each other.
CASES = {"thesis_kitchen": "ROS 1", "thesis_kitchen_tendon": "ROS 2"}
# The can ends upright at its original place, within these limits.
PLACEMENT, TILT = 0.003, 5.0  # m, degrees
# Height of the iiwa 14's flange above its base with the arm straight up: 360 + 420 +
# 400 + 126 mm. A can in the hand is higher.
STRAIGHT_UP = 1.306  # m
PACE_TOLERANCE = 0.01  # relative


@dc.dataclass(frozen=True)
class Witnessed:
    """The motion of the can during a demonstration.

    Attributes:
        sent: Number of messages sent.
        served: Result of serving the station.
        time: Shape (K,) [s].
        position: Position of the can's centre in world, shape (K, 3) [m].
        tilt: Angle of the can's axis to the vertical, shape (K,) [degrees].
    """

    sent: int
    served: Served
    time: Vector
    position: Vector
    tilt: Vector


class Witness(Bridge):
    """Records the pose of an object ten times per second.

    Args:
        object_name: Name of the object.

    Attributes:
        rows: List of (time [s], X_WO).
    """

    ports: Collection[str] = ("object_poses_cheat",)

    def __init__(self, object_name: str):
        self.rows: list[tuple[float, Any]] = []
        self._object = object_name
        self._next = 0.0

    def update(self, time: float, values: Mapping[str, Any]) -> None:
        """Record the pose if it is due."""
        if time >= self._next:
            self._next = time + 0.1
            self.rows.append((time, values["object_poses_cheat"][self._object]))


def run(track: Track) -> ExperimentResult:
    """Serve each scenario to a client in real time."""
    witnessed = {
        scenario: demonstrate(scenario, CASES[scenario]) for scenario in track([*CASES])
    }
    rows = [row for name, one in witnessed.items() for row in rows_of(name, one)]
    tables: dict[str, Mapping[str, npt.ArrayLike]] = {
        name: {
            "time_s": one.time,
            **{f"{axis}_m": one.position[:, i] for i, axis in enumerate("xyz")},
            "tilt_deg": one.tilt,
        }
        for name, one in witnessed.items()
    }
    return ExperimentResult(rows, tables, draw(witnessed))


def rows_of(scenario: str, one: Witnessed) -> list[Row]:
    """Return the result rows of a demonstration."""
    name = f"{scenario}, {CASES[scenario]}"
    moved = 1e3 * (one.position[-1] - one.position[0])
    highest = float(one.position[:, 2].max())
    pace = one.served.sim_time / one.served.wall_time
    return [
        Row.within(name, "messages received", one.sent, one.served.commands, ""),
        Row.within(name, "pace", 1.0, pace, "", absolute=PACE_TOLERANCE),
        Row.at_least(name, "largest height", STRAIGHT_UP, highest, "m"),
        Row.at_most(
            name,
            "distance from its original place",
            1e3 * PLACEMENT,
            float(np.linalg.norm(moved)),
            "mm",
        ),
        Row.at_most(name, "tilt at the end", TILT, float(one.tilt[-1]), "degrees"),
    ]


def demonstrate(name: str, wire: str, overrides: Sequence[str] = ()) -> Witnessed:
    """Serve a scenario in real time to a client that sends the scenario's messages.

    Args:
        name: Name of the scenario.
        wire: One of `bridge_client.WIRES`.
        overrides: Overrides of the scenario, `KEY=VALUE` each.

    Raises:
        ScenarioError: If an override is invalid or roscore is missing.
    """
    scenario = load_scenario(name, overrides=overrides)
    witness = Witness(scenario.task.pick)
    stop = threading.Event()
    with open_wire(wire, "thesis_messages") as opened:
        client = mp.get_context("spawn").Process(
            target=_send, args=(name, list(overrides), opened.make_client), daemon=True
        )

        def connect(inbox: CommandInbox, topics: Sequence[Topic]) -> list[Bridge]:
            bridges = [opened.make_station(inbox, topics), witness]
            client.start()
            threading.Thread(target=stop_after_client, daemon=True).start()
            return bridges

        def stop_after_client() -> None:
            client.join()
            stop.set()

        served = Serve(scenario, connect, name=name, stop=stop)
    times, poses = zip(*witness.rows, strict=True)
    axes = np.array([X_WO.rotation().matrix()[:, 2] for X_WO in poses])
    return Witnessed(
        len(list(messages(scenario))),
        served,
        np.array(times),
        np.array([X_WO.translation() for X_WO in poses]),
        np.rad2deg(np.arccos(np.clip(axes[:, 2], -1.0, 1.0))),
    )


def sent(scenario: Scenario) -> MessagesConfig:
    """Return the configuration of a scenario's messages."""
    planner = scenario.planner
    assert isinstance(planner, Script)
    assert planner.messages is not None
    return planner.messages


def messages(scenario: Scenario) -> Iterator[dict[str, Any]]:
    """Yield the messages of a scenario in order, as data by topic."""
    for step in script_of(scenario):
        for _ in range(round(step.duration * sent(scenario).rate)):
            if step.arm is not None:
                yield {"/kuka": step.arm}
            elif step.closure is not None:
                yield {"/grasp": round(100 * step.closure)}


def _send(name: str, overrides: Sequence[str], make_bridge: MakeBridge) -> None:
    """Run the client's process: send all messages at their rate."""
    scenario = load_scenario(name, overrides=overrides)
    rate, rest = sent(scenario).rate, sent(scenario).rest
    client = Client(make_bridge)
    start = wall.monotonic()
    for i, message in enumerate(messages(scenario)):
        wall.sleep(max(start + i / rate - wall.monotonic(), 0.0))
        client.send(message)
    wall.sleep(rest)
    client.close()


def draw(witnessed: Mapping[str, Witnessed]) -> Any:
    """Plot the can's height and its horizontal distance from its original place."""
    figure = make_figure(9.0, 3.6)
    axes = figure.subplots(1, len(witnessed), sharey=True, squeeze=False)[0]
    for ax, (name, one) in zip(axes, witnessed.items(), strict=True):
        style_axes(ax, xlabel="time [s]", ylabel="[m]")
        ax.plot(one.time, one.position[:, 2], label="height")
        distance = np.linalg.norm((one.position - one.position[0])[:, :2], axis=1)
        ax.plot(one.time, distance, label="distance from its place")
        ax.set_title(f"{name}, {CASES[name]}", loc="left", fontsize=9)
        ax.legend(fontsize=8)
    return figure
