"""The SRG thesis's demonstration, commanded by messages over ROS 1 and ROS 2.

A client in a separate process sends the thesis's 5752 messages at the thesis's pace to
a station that is served in real time. An observer reads the ground truth and records
the motion of the can. The can must end upright at its original place.
"""

import multiprocessing as mp
import threading
import time as wall
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

import experiments.runner as ex
from drake_srg.recording.rosbag import Topic
from drake_srg.robot.serve.bridge import Bridge
from drake_srg.robot.serve.commands import CommandInbox
from drake_srg.robot.serve.loop import Serve
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.scenario.schema import script_of
from experiments.stands.bridge_client import Client, MakeBridge, open_wire


class Witness(Bridge):
    """Records time [s] and pose X_WO of an object ten times per second, in `rows`."""

    ports: Collection[str] = ("object_poses_cheat",)

    def __init__(self, name: str):
        self.rows: list[tuple[float, Any]] = []
        self._name, self._next = name, 0.0

    def update(self, time: float, values: Mapping[str, Any]) -> None:
        if time >= self._next:
            self._next = time + 0.1
            self.rows.append((time, values["object_poses_cheat"][self._name]))


def cases() -> list[ex.Case]:
    """One wire per driver is enough: drivers and wires do not affect each other."""
    return [
        {"scenario": "thesis_kitchen", "wire": "ROS 1"},
        {"scenario": "thesis_kitchen_tendon", "wire": "ROS 2"},
    ]


def trial(scenario: str, wire: str) -> ex.Measures:
    return demonstrate(scenario, wire)


def demonstrate(name: str, wire: str, overrides: Sequence[str] = ()) -> ex.Measures:
    """Return the measures of a demonstration with changes to the scenario."""
    scenario = load_scenario(name, overrides=overrides)
    witness, stop = Witness(scenario.task.pick), threading.Event()
    with open_wire(wire, "thesis_messages") as opened:
        arguments = (name, overrides, opened.make_client)
        client = mp.get_context("spawn").Process(
            target=_send, args=arguments, daemon=True
        )

        def stop_after_client() -> None:
            client.join()
            stop.set()

        def connect(inbox: CommandInbox, topics: Sequence[Topic]) -> list[Bridge]:
            bridges = [opened.make_station(inbox, topics), witness]
            client.start()
            threading.Thread(target=stop_after_client, daemon=True).start()
            return bridges

        served = Serve(scenario, connect, name=name, stop=stop)
    times, poses = zip(*witness.rows, strict=True)
    position = np.array([X_WO.translation() for X_WO in poses])
    upright = np.clip(poses[-1].rotation().matrix()[2, 2], -1.0, 1.0)
    away = 1e3 * np.linalg.norm(position - position[0], axis=1)
    return {
        "sent": len(list(messages(scenario))),
        "messages received []": served.commands,
        "pace []": served.sim_time / served.wall_time,
        "largest height [m]": max(position[:, 2]),
        "distance from its original place [mm]": away[-1],
        "tilt at the end [degrees]": np.rad2deg(np.arccos(upright)),
        "time [s]": times,
        "height of the can [m]": position[:, 2],
    }


def messages(scenario: Scenario) -> Iterator[dict[str, Any]]:
    """Yield the messages of a scenario in order, as data by topic."""
    planner: Any = scenario.planner
    for step in script_of(scenario):
        for _ in range(round(step.duration * planner.messages.rate)):
            if step.arm is not None:
                yield {"/kuka": step.arm}
            elif step.closure is not None:
                yield {"/grasp": round(100 * step.closure)}


def _send(name: str, overrides: Sequence[str], make_bridge: MakeBridge) -> None:
    """Run the client's process: send all messages at their rate."""
    scenario = load_scenario(name, overrides=overrides)
    planner: Any = scenario.planner
    config, client = planner.messages, Client(make_bridge)
    start = wall.monotonic()
    for i, message in enumerate(messages(scenario)):
        wall.sleep(max(start + i / config.rate - wall.monotonic(), 0.0))
        client.send(message)
    wall.sleep(config.rest)
    client.close()


thesis_messages = ex.Experiment(
    "The SRG thesis's demonstration, commanded by messages over ROS 1 and ROS 2.",
    cases,
    trial,
    {
        "messages received": lambda own: ex.within(own.one("sent")),
        "pace": ex.within(1.0, absolute=0.01),
        # Of the iiwa 14's flange above its base with the arm straight up: 360 + 420 +
        # 400 + 126 mm. A can in the hand is higher.
        "largest height": ex.at_least(1.306, source="data sheet"),
        "distance from its original place": ex.at_most(3.0),
        "tilt at the end": ex.at_most(5.0),
    },
    by=("scenario", "wire"),
    picture=[ex.Curves("time [s]", "height of the can [m]")],
    serial=True,
)
