"""Pace and delays of a served station under 1 kHz of commands, over ROS 1 and ROS 2.

A client in this process commands a kitchen that `drake-srg serve` runs in another
process, on all four topics of the thesis at once. Its commands change from time to
time. The delay is the time from a change until the station publishes that its drivers
follow it. It consists of a wait for the next control period and of scheduling, so it
does not scale with the machine's speed.
"""

import contextlib
import time as wall
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

import experiments.runner as ex
from drake_srg.robot.serve.loop import control_period
from drake_srg.robot.serve.pictures import COLOR, camera_topics, served_camera
from drake_srg.scenario import load_scenario
from drake_srg.types import Vector
from experiments.stands import bridge_client as bridges

_NAME, SCENARIO = "bridge_load", "kitchen"
# Messages on each topic [Hz]. The station reads commands every 5 ms; 27 Hz is not in
# step with that, so the slow commands arrive at all times in between.
LOADS = {"1 kHz": 1000.0, "27 Hz": 27.0}
# Scenarios whose full speed is measured.
FREE = ("kitchen", "kitchen_tendon", "kitchen_fast", "assistive_arm", "gripper_bench")
# A command moves one joint of the arm by STEP [rad], and no other command moves it for
# REST [s]. So it comes to rest, and its next motion shows the next command's effect.
STEP, REST = 0.01, 0.8
# A joint that has moved by more is not at rest [rad]. In the first period of 5 ms it
# moves by jerk x time^3 / 6 = 3e-8 rad.
_MOVED = 1e-9
# How long to wait for the station to reach the last commands [s, real].
_SETTLING = 20.0


class Change(NamedTuple):
    """A change of the commanded arm position: real time [s], joint, its rest [rad]."""

    time: float
    joint: int
    rest: float


def cases(duration: float = 60.0) -> list[ex.Case]:
    """Load the station over each wire, and run the scenarios at full speed.

    Args:
        duration: Duration of each load [s].
    """
    cases = [
        *ex.grid(wire=bridges.WIRES, what=LOADS, amount=[duration]),
        *ex.grid(wire=["ROS 2"], what=FREE, amount=[8.0]),  # s
        *ex.grid(wire=bridges.WIRES, what=["image"], amount=[100]),  # images
    ]
    return [
        {"name": c["what"] if c["what"] in FREE else f"{c['wire']}, {c['what']}", **c}
        for c in cases
    ]


def trial(name: str, wire: str, what: str, amount: float) -> ex.Measures:
    """Measure delays under a load, full speed without commands, or cost of images."""
    if what == "image":
        return {"time to send, median [ms]": 1e3 * image_cost(wire, int(amount))}
    with bridges.open_wire(wire, _NAME) as opened:
        if what in FREE:
            options = ("--no-record", "--rate", "0", *opened.arguments)
            station = bridges.ServedProcess(what, *options)
            wall.sleep(amount)
            served = station.stop()
            return {"largest real-time factor []": served.sim_time / served.wall_time}
        station = bridges.ServedProcess(SCENARIO, "--no-record", *opened.arguments)
        try:
            with contextlib.closing(bridges.Client(opened.make_client)) as client:
                found = measure_delays(client, LOADS[what], amount)
        finally:
            served = station.stop()
    delays = found["delay [ms]"]
    quarter = max(len(delays) // 4, 1)
    growth = np.median(delays[-quarter:]) - np.median(delays[:quarter])
    return found | {
        "pace []": served.sim_time / served.seen_time,
        "messages [1/s]": found["sent"] / served.wall_time,
        "messages received []": served.commands,
        "delay, median [ms]": np.median(delays),
        "delay, 99th percentile [ms]": np.percentile(delays, 99),
        "delay, longest [ms]": max(delays),
        "delay, growth of the median [ms]": growth,
    }


def measure_delays(client: bridges.Client, rate: float, duration: float) -> ex.Measures:
    """Command a served kitchen on all topics, and measure how soon it follows.

    At each topic's rate [Hz], for a real time [s].
    """
    home = client.arm[-1][1]
    target, closed = home.copy(), 0
    changes: list[Change] = []
    n, start, steps = len(home), wall.monotonic(), round(duration * rate)
    next_change = start + 1.0
    random = np.random.default_rng(0)
    for step in range(steps):
        wall.sleep(max(start + step / rate - wall.monotonic(), 0.0))
        now = wall.monotonic()
        if now >= next_change:
            joint = len(changes) % n
            changes.append(Change(now, joint, target[joint]))
            there_and_back = STEP if target[joint] == home[joint] else 0.0
            target[joint] = home[joint] + there_and_back
            # Random, so that changes fall anywhere between the station's reads.
            next_change = now + REST / n * random.uniform(1.0, 1.2)
        closed = step % 101
        fingers = {"/position_grasp": [0.0] * 4, "/grasp": closed, "/startgrasp": True}
        client.send({**fingers, "/kuka": target})

    def deviation() -> float:
        return max(
            abs(client.closure[-1][1][0] - closed / 100.0),
            float(np.abs(client.arm[-1][1] - target).max()),
        )

    end = wall.monotonic() + _SETTLING
    while deviation() > 0.0 and wall.monotonic() < end:
        wall.sleep(0.05)
    return {
        "sent": 4 * steps,
        "time [s]": [change.time - start for change in changes],
        "delay [ms]": 1e3 * find_delays(client.arm, changes),
        "deviation from the last commands []": deviation(),
    }


def find_delays(
    published: Sequence[tuple[float, Vector]], changes: Sequence[Change]
) -> Vector:
    """Return the time from each change until its joint left its rest (K,) [s].

    Published are commanded arm positions [rad] at real times [s]. NaN: it did not move.
    """
    times = np.array([time for time, _ in published])
    positions = np.array([position for _, position in published])
    delays = []
    for change in changes:
        after = slice(int(np.searchsorted(times, change.time)), None)
        distance = np.abs(positions[after, change.joint] - change.rest)
        moved = np.flatnonzero(distance > _MOVED)
        delays.append(times[after][moved[0]] - change.time if len(moved) else np.nan)
    return np.array(delays)


def image_cost(wire: str, count: int) -> float:
    """Return the median of the real times in which a station sends an image [s]."""
    camera = served_camera(load_scenario(SCENARIO))
    assert camera is not None
    topic = camera_topics(*camera)[COLOR]
    pixels = np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    costs = []
    with (
        bridges.open_wire(wire, _NAME) as opened,
        contextlib.closing(
            opened.make_station(bridges.silent_inbox(), [topic])
        ) as bridge,
        bridges.watch(opened.make_client, topic.name, topic.type),
    ):
        bridges.wait_for(lambda: bridge.has_subscribers(COLOR))
        for i in range(count):
            wall.sleep(0.03)
            start = wall.perf_counter()
            bridge.publish(topic, 0.1 * i, [pixels])
            costs.append(wall.perf_counter() - start)
    return float(np.median(costs))


PERIOD = 1e3 * control_period(load_scenario(SCENARIO))  # ms
# Allowed delay beyond a control period, for the wires and the processes [ms]. From run
# to run, a delay may move by that much; the longest, a single event, by the limit of
# all but 1 % of the delays.
SLACK = 5.0
bridge_load = ex.Experiment(
    "Pace and delays of a served station under 1 kHz of commands, by ROS 1 and ROS 2.",
    cases,
    trial,
    {
        "pace": ex.within(1.0, absolute=0.01),
        "messages received": lambda own: ex.within(own.one("sent")),
        "deviation from the last commands": ex.within(0.0),
        "delay, median": ex.number(spread=SLACK),
        "delay, 99th percentile": ex.at_most(PERIOD + SLACK, spread=SLACK),
        "delay, longest": ex.number(spread=PERIOD + SLACK),
        # Client and station may drift against each other, by at most one period.
        "delay, growth of the median": ex.at_most(PERIOD, spread=PERIOD),
        "time to send, median": ex.at_most(3.0, clock="time"),
        "largest real-time factor": ex.number(clock="rate"),
    },
    picture=[
        ex.Points("time [s]", "delay [ms]", where={"what": load}, limit=PERIOD + SLACK)
        for load in LOADS
    ],
    serial=True,
)
